#include "transport/lights/polygon_lights.h"

#include <algorithm>

#include "core/fast_math.h"
#include "core/sampling.h"

namespace fogbank::transport {

namespace {

Vec3f unit(const Vec3f& v) { return v / glm::length(v); }

}  // namespace

TriangleLight::TriangleLight(const std::array<Vec3f, 3>& vertices, const std::array<Vec2f, 3>& uvs,
                             scene::TexturePointer radiance)
    : AreaLight(std::move(radiance)), vertices_(vertices), uvs_(uvs) {
  const Vec3f cross = glm::cross(vertices[1] - vertices[0], vertices[2] - vertices[0]);
  const float length = glm::length(cross);
  normal_ = cross / length;
  area_ = 0.5f * length;
  const Vec3f center = (vertices[0] + vertices[1] + vertices[2]) / 3.0f;
  float radius = 0;
  for (const Vec3f& vertex : vertices) radius = std::fmax(radius, glm::length(vertex - center));
  bounds_ = {center, radius, normal_, 1, 0, mean_luminance_ * area_};
}

float TriangleLight::solid_angle(const Vec3f& x) const {
  // Van Oosterom and Strackee 1983: method.md 4.1, with A from vertex differences (4.2).
  const Vec3f r1 = vertices_[0] - x;
  const Vec3f r2 = vertices_[1] - x;
  const Vec3f r3 = vertices_[2] - x;
  const float l1 = glm::length(r1);
  const float l2 = glm::length(r2);
  const float l3 = glm::length(r3);
  const float a = -2.0f * area_ * glm::dot(r1, normal_);
  const float b = l1 * l2 * l3 + glm::dot(r1, r2) * l3 + glm::dot(r2, r3) * l1 + glm::dot(r3, r1) * l2;
  return a > 0 ? 2.0f * std::atan2(a, b) : 0.0f;
}

std::optional<LightSample> TriangleLight::sample(const Vec3f& x, const Vec2f& u) const {
  const Vec3f to_plane = vertices_[0] - x;
  const float height = -glm::dot(to_plane, normal_);
  if (!(height > 0)) return std::nullopt;
  const float omega = solid_angle(x);
  if (omega < least_spherical_solid_angle) {
    const Vec2f b = square_to_uniform_triangle(u);
    const Vec3f y = vertices_[0] + (vertices_[1] - vertices_[0]) * b.x + (vertices_[2] - vertices_[0]) * b.y;
    return sample_of_point(x, y, normal_, uvs_[0] * (1 - b.x - b.y) + uvs_[1] * b.x + uvs_[2] * b.y,
                           1 / area_);
  }
  // Arvo 1995, "Stratified Sampling of Spherical Triangles": a sub-triangle of area u.x * omega with one side
  // along AB, then a point on the arc from B to the sub-triangle's vertex.
  const Vec3f a = unit(vertices_[0] - x);
  const Vec3f b = unit(vertices_[1] - x);
  const Vec3f c = unit(vertices_[2] - x);
  const Vec3f n_ab = glm::cross(a, b);
  const Vec3f n_ca = glm::cross(c, a);
  const float length_ab = glm::length(n_ab);
  const float length_ca = glm::length(n_ca);
  if (!(length_ab > 0) || !(length_ca > 0)) return std::nullopt;
  const float cos_alpha = std::clamp(-glm::dot(n_ab, n_ca) / (length_ab * length_ca), -1.0f, 1.0f);
  const float sin_alpha = safe_sqrt(1 - cos_alpha * cos_alpha);
  const float alpha = std::acos(cos_alpha);
  const float cos_c = glm::dot(a, b);
  const float area = u.x * omega;
  const float s = std::sin(area - alpha);
  const float t = std::cos(area - alpha);
  const float p = t - cos_alpha;
  const float q = s + sin_alpha * cos_c;
  const float denominator = (q * s + p * t) * sin_alpha;
  const float cos_b_hat =
      denominator != 0 ? std::clamp(((t * q - s * p) * cos_alpha - q) / denominator, -1.0f, 1.0f) : 1.0f;
  const Vec3f c_perpendicular = c - a * glm::dot(c, a);
  const float c_length = glm::length(c_perpendicular);
  if (!(c_length > 0)) return std::nullopt;
  const Vec3f c_hat = a * cos_b_hat + c_perpendicular * (safe_sqrt(1 - cos_b_hat * cos_b_hat) / c_length);
  const float cos_theta = std::clamp(1 - u.y * (1 - glm::dot(c_hat, b)), -1.0f, 1.0f);
  const Vec3f perpendicular = c_hat - b * glm::dot(c_hat, b);
  const float perpendicular_length = glm::length(perpendicular);
  Vec3f direction = b;
  if (perpendicular_length > 0)
    direction =
        unit(b * cos_theta + perpendicular * (safe_sqrt(1 - cos_theta * cos_theta) / perpendicular_length));
  const float cosine = -glm::dot(direction, normal_);
  if (!(cosine > 0)) return std::nullopt;
  const float distance = height / cosine;
  Spectrum radiance;
  if (radiance_->is_constant()) {
    radiance = radiance_->evaluate(uvs_[0]);
  } else {
    const Vec3f inside = x + direction * distance - vertices_[0];
    const Vec3f e1 = vertices_[1] - vertices_[0];
    const Vec3f e2 = vertices_[2] - vertices_[0];
    const float b1 = std::clamp(glm::dot(glm::cross(inside, e2), normal_) / (2 * area_), 0.0f, 1.0f);
    const float b2 = std::clamp(glm::dot(glm::cross(e1, inside), normal_) / (2 * area_), 0.0f, 1.0f - b1);
    radiance = radiance_->evaluate(uvs_[0] * (1 - b1 - b2) + uvs_[1] * b1 + uvs_[2] * b2);
  }
  return LightSample{direction, distance, radiance, 1 / omega};
}

float TriangleLight::pdf(const Vec3f& x, const Vec3f& direction, const scene::SurfaceInteraction* hit) const {
  const float omega = solid_angle(x);
  return omega < least_spherical_solid_angle ? pdf_of_hit(direction, *hit, 1 / area_) : 1 / omega;
}

float TriangleLight::fluence(const Vec3f& x) const { return mean_luminance_ * solid_angle(x); }

RectangleLight::RectangleLight(const Vec3f& corner, const Vec3f& edge_x, const Vec3f& edge_y,
                               const std::array<Vec2f, 3>& uvs, scene::TexturePointer radiance)
    : AreaLight(std::move(radiance)),
      corner_(corner),
      width_(glm::length(edge_x)),
      height_(glm::length(edge_y)),
      uvs_(uvs) {
  const Vec3f tangent = edge_x / width_;
  const Vec3f normal = unit(glm::cross(edge_x, edge_y));
  frame_ = {tangent, glm::cross(normal, tangent), normal};
  bounds_ = {corner + 0.5f * (edge_x + edge_y), 0.5f * std::sqrt(sqr(width_) + sqr(height_)), normal, 1, 0,
             mean_luminance_ * width_ * height_};
}

RectangleLight::Local RectangleLight::localise(const Vec3f& x) const {
  const Vec3f d = corner_ - x;
  Local local{};
  local.x0 = glm::dot(d, frame_.tangent);
  local.y0 = glm::dot(d, frame_.bitangent);
  local.z0 = glm::dot(d, frame_.normal);  // < 0 on the emitting side
  local.x1 = local.x0 + width_;
  local.y1 = local.y0 + height_;
  if (!(local.z0 < 0)) return local;
  // Plane normals of the four sides; only their z component is needed (paper, listing 1).
  const float z_squared = sqr(local.z0);
  const float n0 = -local.y0 / std::sqrt(z_squared + sqr(local.y0));
  const float n1 = local.x1 / std::sqrt(z_squared + sqr(local.x1));
  const float n2 = local.y1 / std::sqrt(z_squared + sqr(local.y1));
  const float n3 = -local.x0 / std::sqrt(z_squared + sqr(local.x0));
  const float g0 = std::acos(std::clamp(-n0 * n1, -1.0f, 1.0f));
  const float g1 = std::acos(std::clamp(-n1 * n2, -1.0f, 1.0f));
  const float g2 = std::acos(std::clamp(-n2 * n3, -1.0f, 1.0f));
  const float g3 = std::acos(std::clamp(-n3 * n0, -1.0f, 1.0f));
  local.b0 = n0;
  local.b1 = n2;
  local.k = 2 * pi - g2 - g3;
  local.solid_angle = g0 + g1 - local.k;
  return local;
}

std::optional<LightSample> RectangleLight::sample(const Vec3f& x, const Vec2f& u) const {
  const Local local = localise(x);
  if (!(local.z0 < 0)) return std::nullopt;
  float a = 0;
  float b = 0;
  float pdf = 0;
  if (local.solid_angle < least_spherical_solid_angle) {
    a = local.x0 + u.x * width_;
    b = local.y0 + u.y * height_;
  } else {
    const float au = u.x * local.solid_angle + local.k;
    const float fu = (std::cos(au) * local.b0 - local.b1) / std::sin(au);
    const float cu = std::clamp(std::copysign(1.0f, fu) / std::sqrt(sqr(fu) + sqr(local.b0)), -1.0f, 1.0f);
    const float xu = -(cu * local.z0) / std::fmax(safe_sqrt(1 - cu * cu), 1e-7f);
    a = std::clamp(xu, local.x0, local.x1);
    const float d = std::sqrt(sqr(a) + sqr(local.z0));
    const float h0 = local.y0 / std::sqrt(sqr(d) + sqr(local.y0));
    const float h1 = local.y1 / std::sqrt(sqr(d) + sqr(local.y1));
    const float hv = h0 + u.y * (h1 - h0);
    const float hv_squared = hv * hv;
    b = hv_squared < 1 - 1e-6f ? std::clamp(hv * d / std::sqrt(1 - hv_squared), local.y0, local.y1)
                               : local.y1;
    pdf = 1 / local.solid_angle;
  }
  const float distance_squared = sqr(a) + sqr(b) + sqr(local.z0);
  const float distance = std::sqrt(distance_squared);
  const Vec3f direction = (frame_.tangent * a + frame_.bitangent * b + frame_.normal * local.z0) / distance;
  if (pdf == 0) pdf = distance_squared * distance / (-local.z0 * width_ * height_);
  if (!std::isfinite(pdf) || !(distance > 0)) return std::nullopt;
  const Vec2f uv = uvs_[0] + (uvs_[1] - uvs_[0]) * ((a - local.x0) / width_) +
                   (uvs_[2] - uvs_[0]) * ((b - local.y0) / height_);
  return LightSample{direction, distance, radiance_->evaluate(uv), pdf};
}

float RectangleLight::pdf(const Vec3f& x, const Vec3f& direction,
                          const scene::SurfaceInteraction* hit) const {
  const Local local = localise(x);
  if (!(local.z0 < 0)) return 0;
  return local.solid_angle < least_spherical_solid_angle ? pdf_of_hit(direction, *hit, 1 / (width_ * height_))
                                                         : 1 / local.solid_angle;
}

float RectangleLight::fluence(const Vec3f& x) const {
  constexpr float at_origin = 0;
  float value = 0;
  fluence_along(x, Vec3f(0), &at_origin, 1, &value);
  return value;
}

LightShape RectangleLight::shape() const {
  return RectangleShape{corner_, frame_.tangent * width_, frame_.bitangent * height_, uvs_, radiance_.get()};
}

void RectangleLight::fluence_along(const Vec3f& origin, const Vec3f& direction, const float* t, int count,
                                   float* values) const {
  // The four corner terms atan(X Y / (h r)) of ratio-records.md section 1, exact up to the error of
  // fast_atan. Far away the differences of atan cancel; there the small-source form is used, off by (size /
  // distance)^2 / 4.
  const Vec3f d = corner_ - origin;
  const Vec3f start(glm::dot(d, frame_.tangent), glm::dot(d, frame_.bitangent), -glm::dot(d, frame_.normal));
  const Vec3f step(-glm::dot(direction, frame_.tangent), -glm::dot(direction, frame_.bitangent),
                   glm::dot(direction, frame_.normal));
  const float width = width_;
  const float height = height_;
  const float area = width * height;
  const float far_squared = 64 * (width > height ? width * width : height * height);
  const float radiance = mean_luminance_;
  for (int i = 0; i < count; ++i) {
    const float x0 = start.x + t[i] * step.x;
    const float y0 = start.y + t[i] * step.y;
    const float h = start.z + t[i] * step.z;
    const float x1 = x0 + width;
    const float y1 = y0 + height;
    const float h2 = h * h;
    const float middle_x = 0.5f * (x0 + x1);
    const float middle_y = 0.5f * (y0 + y1);
    const float distance_squared = h2 + middle_x * middle_x + middle_y * middle_y;
    const float small_source = area * h / (distance_squared * std::sqrt(distance_squared));
    const float a = fast_atan(x1 * y1 / (h * std::sqrt(x1 * x1 + y1 * y1 + h2)));
    const float b = fast_atan(x0 * y1 / (h * std::sqrt(x0 * x0 + y1 * y1 + h2)));
    const float c = fast_atan(x1 * y0 / (h * std::sqrt(x1 * x1 + y0 * y0 + h2)));
    const float e = fast_atan(x0 * y0 / (h * std::sqrt(x0 * x0 + y0 * y0 + h2)));
    const float corners = a - b - c + e;
    const float near = corners > 1e-7f ? corners : 1e-7f;
    const float omega = distance_squared > far_squared ? small_source : near;
    values[i] = h > 0 ? radiance * omega : 0.0f;
  }
}

}  // namespace fogbank::transport
