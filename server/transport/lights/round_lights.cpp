#include "transport/lights/round_lights.h"

#include <algorithm>
#include <limits>

#include "core/frame.h"
#include "core/sampling.h"

namespace fogbank::transport {

namespace {

/// 1 - cos of the half angle under which a sphere is seen: r^2/d^2 / (1 + sqrt(1 - r^2/d^2)), without
/// cancellation.
float cap_one_minus_cos(float radius, float distance_squared) {
  const float sine_squared = sqr(radius) / distance_squared;
  return sine_squared / (1 + safe_sqrt(1 - sine_squared));
}

}  // namespace

SphereLight::SphereLight(const Vec3f& center, float radius, bool inwards, const Mat4d& to_local,
                         scene::TexturePointer radiance)
    : AreaLight(std::move(radiance)), inwards_(inwards), to_local_(Mat3f(glm::dmat3(to_local))) {
  bounds_ = {center, radius, {0, 0, 1}, -1, 0, mean_luminance_ * pi * sqr(radius)};
}

Vec2f SphereLight::uv_of(const Vec3f& normal) const {
  // Mitsuba's sphere: u = azimuth / 2 pi in [0, 1), v = polar angle / pi.
  const Vec3f local = glm::normalize(to_local_ * normal);
  float phi = std::atan2(local.y, local.x);
  if (phi < 0) phi += 2 * pi;
  return {phi * (0.5f * inv_pi), std::acos(std::clamp(local.z, -1.0f, 1.0f)) * inv_pi};
}

std::optional<LightSample> SphereLight::sample(const Vec3f& x, const Vec2f& u) const {
  const Vec3f towards = bounds_.center - x;
  const float distance_squared = glm::dot(towards, towards);
  const float radius = bounds_.radius;
  const bool outside = distance_squared > sqr(radius);
  if (outside == inwards_ && outside) {
    // An inward emitter seen from outside shows the far inner wall only where a ray could enter: it can't.
    return std::nullopt;
  }
  if (!outside) {
    if (!inwards_) return std::nullopt;
    const Vec3f normal = square_to_uniform_sphere(u);
    return sample_of_point(x, bounds_.center + radius * normal, -normal, uv_of(normal),
                           1 / (4 * pi * sqr(radius)));
  }
  const float one_minus_cos_max = cap_one_minus_cos(radius, distance_squared);
  const float distance_to_center = std::sqrt(distance_squared);
  const Vec3f local = square_to_uniform_cone(u, one_minus_cos_max);
  const Vec3f direction = Frame::from_normal(towards / distance_to_center).to_world(local);
  // Distance to the near intersection, from the chord's half length; clamped where rounding puts it past the
  // rim.
  const float sine_squared = std::fmax(0.0f, sqr(local.x) + sqr(local.y));
  const float half_chord = safe_sqrt(sqr(radius) - distance_squared * sine_squared);
  const float distance = distance_to_center * local.z - half_chord;
  const Vec3f normal = glm::normalize(x + direction * distance - bounds_.center);
  return LightSample{direction, distance, radiance_->evaluate(uv_of(normal)),
                     1 / (2 * pi * one_minus_cos_max)};
}

float SphereLight::pdf(const Vec3f& x, const Vec3f& direction, const scene::SurfaceInteraction* hit) const {
  const Vec3f towards = bounds_.center - x;
  const float distance_squared = glm::dot(towards, towards);
  if (distance_squared > sqr(bounds_.radius))
    return inwards_ ? 0 : 1 / (2 * pi * cap_one_minus_cos(bounds_.radius, distance_squared));
  return inwards_ ? pdf_of_hit(direction, *hit, 1 / (4 * pi * sqr(bounds_.radius))) : 0;
}

float SphereLight::fluence(const Vec3f& x) const {
  const Vec3f towards = bounds_.center - x;
  const float distance_squared = glm::dot(towards, towards);
  if (distance_squared > sqr(bounds_.radius))
    return inwards_ ? 0 : mean_luminance_ * 2 * pi * cap_one_minus_cos(bounds_.radius, distance_squared);
  return inwards_ ? mean_luminance_ * 4 * pi : 0;
}

DiskLight::DiskLight(const Vec3f& center, const Vec3f& axis_x, const Vec3f& axis_y, bool flipped,
                     scene::TexturePointer radiance)
    : AreaLight(std::move(radiance)), axis_x_(axis_x), axis_y_(axis_y) {
  const Vec3f cross = glm::cross(axis_x, axis_y);
  const float length = glm::length(cross);
  area_ = pi * length;
  bounds_ = {center,
             std::fmax(glm::length(axis_x), glm::length(axis_y)),
             (flipped ? -1.0f : 1.0f) * cross / length,
             1,
             0,
             mean_luminance_ * area_};
}

std::optional<LightSample> DiskLight::sample(const Vec3f& x, const Vec2f& u) const {
  const Vec2f p = square_to_disk_concentric(u);
  const Vec3f y = bounds_.center + axis_x_ * p.x + axis_y_ * p.y;
  // Mitsuba's disk: u = radius, v = azimuth / 2 pi in [0, 1).
  float v = 0;
  if (!radiance_->is_constant()) {
    v = std::atan2(p.y, p.x) * (0.5f * inv_pi);
    if (v < 0) v += 1;
  }
  return sample_of_point(x, y, bounds_.axis, {glm::length(p), v}, 1 / area_);
}

float DiskLight::pdf(const Vec3f&, const Vec3f& direction, const scene::SurfaceInteraction* hit) const {
  return pdf_of_hit(direction, *hit, 1 / area_);
}

float DiskLight::fluence(const Vec3f& x) const {
  // The cap of a disk seen along its axis, times the cosine: exact on the axis and far away.
  const Vec3f from_light = x - bounds_.center;
  const float height = glm::dot(from_light, bounds_.axis);
  if (!(height > 0)) return 0;
  const float distance_squared = glm::dot(from_light, from_light);
  const float radius_squared = area_ * inv_pi;
  const float distance = std::sqrt(distance_squared);
  const float hypotenuse = std::sqrt(distance_squared + radius_squared);
  return mean_luminance_ * 2 * pi * radius_squared * height /
         (distance * hypotenuse * (hypotenuse + distance));
}

CylinderLight::CylinderLight(const Vec3f& base, const Vec3f& top, const Vec3f& axis_x, bool inwards,
                             bool mirrored, scene::TexturePointer radiance)
    : AreaLight(std::move(radiance)),
      base_(base),
      axis_(glm::normalize(top - base)),
      axis_x_(glm::normalize(axis_x)),
      axis_y_(glm::cross(axis_, axis_x_) * (mirrored ? -1.0f : 1.0f)),
      length_(glm::length(top - base)),
      radius_(glm::length(axis_x)),
      inwards_(inwards) {
  bounds_ = {0.5f * (base + top),
             std::sqrt(sqr(0.5f * length_) + sqr(radius_)),
             {0, 0, 1},
             -1,
             0,
             mean_luminance_ * 2 * radius_ * length_};
}

float CylinderLight::visible_half_angle(const Vec3f& x, float& middle) const {
  const Vec3f from_base = x - base_;
  const float px = glm::dot(from_base, axis_x_);
  const float py = glm::dot(from_base, axis_y_);
  const float distance = std::sqrt(px * px + py * py);
  middle = std::atan2(py, px);
  // A normal n faces x when n.p > radius; for the inner side when n.p < radius.
  if (distance <= radius_) return inwards_ ? pi : 0;
  const float facing = std::acos(radius_ / distance);
  if (!inwards_) return facing;
  middle += pi;
  return pi - facing;
}

std::optional<LightSample> CylinderLight::sample(const Vec3f& x, const Vec2f& u) const {
  float middle = 0;
  const float half_angle = visible_half_angle(x, middle);
  if (!(half_angle > 0)) return std::nullopt;
  float angle = middle + (2 * u.x - 1) * half_angle;
  const Vec3f normal = axis_x_ * std::cos(angle) + axis_y_ * std::sin(angle);
  const Vec3f y = base_ + axis_ * (u.y * length_) + normal * radius_;
  angle -= 2 * pi * std::floor(angle / (2 * pi));
  return sample_of_point(x, y, inwards_ ? -normal : normal, {angle * (0.5f * inv_pi), u.y},
                         1 / (2 * half_angle * radius_ * length_));
}

float CylinderLight::pdf(const Vec3f& x, const Vec3f& direction, const scene::SurfaceInteraction* hit) const {
  float middle = 0;
  const float half_angle = visible_half_angle(x, middle);
  return half_angle > 0 ? pdf_of_hit(direction, *hit, 1 / (2 * half_angle * radius_ * length_)) : 0;
}

float CylinderLight::fluence(const Vec3f& x) const {
  // Approximate: the silhouette's area 2 r L, foreshortened as seen from the middle, over the squared
  // distance to the nearest point of the axis segment, bounded near the surface. Importance only; positive
  // wherever light can arrive.
  float middle = 0;
  if (!(visible_half_angle(x, middle) > 0)) return 0;
  const Vec3f from_base = x - base_;
  const float along = std::clamp(glm::dot(from_base, axis_), 0.0f, length_);
  const Vec3f to_axis = from_base - axis_ * along;
  const float nearest_squared = std::fmax(glm::dot(to_axis, to_axis), sqr(radius_));
  const Vec3f from_center = x - bounds_.center;
  const float across = glm::length(from_center - axis_ * glm::dot(from_center, axis_));
  const float foreshortening =
      std::fmax(across / std::fmax(glm::length(from_center), std::numeric_limits<float>::min()), 0.1f);
  return mean_luminance_ * 2 * radius_ * length_ * foreshortening /
         (nearest_squared + 0.25f * length_ * std::sqrt(nearest_squared));
}

}  // namespace fogbank::transport
