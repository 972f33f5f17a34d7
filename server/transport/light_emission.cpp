#include "transport/light_emission.h"

#include <algorithm>

#include "core/sampling.h"

namespace fogbank::transport {

namespace {

/// Rays leave surfaces by this share of the size of their coordinates, so that they don't hit the light.
constexpr float surface_offset = 4e-6f;
/// Part of the choice of a light that doesn't follow power: the sky outweighs a lamp in a room manifold.
constexpr double even_share = 0.5;
/// The disk for light from infinity is that much larger than the scene.
constexpr float margin = 1.001f;
/// Places of a light that are asked for their medium, a side.
constexpr int places_a_side = 3;
/// Of more lights each ray asks for itself: asking all of them would take longer than a pass.
constexpr uint32_t most_lights_asked = 1024;

/// Place on a light and the normal that it emits around.
struct Place {
  Vec3f position{0};
  Vec3f normal{0, 0, 1};
  Vec2f uv{0};
  float area = 0;  ///< of the whole light
  const scene::Texture* radiance = nullptr;
};

/// Uniform by area; nullopt for lights without one.
struct PlaceOnLight {
  Vec2f u;

  std::optional<Place> operator()(const RectangleShape& shape) const {
    const Vec3f cross = glm::cross(shape.edge_x, shape.edge_y);
    const float area = glm::length(cross);
    return Place{shape.corner + shape.edge_x * u.x + shape.edge_y * u.y, cross / area,
                 shape.uvs[0] + (shape.uvs[1] - shape.uvs[0]) * u.x + (shape.uvs[2] - shape.uvs[0]) * u.y,
                 area, shape.radiance};
  }
  std::optional<Place> operator()(const TriangleShape& shape) const {
    const Vec2f b = square_to_uniform_triangle(u);
    const Vec3f edge_1 = shape.vertices[1] - shape.vertices[0];
    const Vec3f edge_2 = shape.vertices[2] - shape.vertices[0];
    const Vec3f cross = glm::cross(edge_1, edge_2);
    const float length = glm::length(cross);
    return Place{shape.vertices[0] + edge_1 * b.x + edge_2 * b.y, cross / length,
                 shape.uvs[0] * (1 - b.x - b.y) + shape.uvs[1] * b.x + shape.uvs[2] * b.y, 0.5f * length,
                 shape.radiance};
  }
  std::optional<Place> operator()(const SphereShape& shape) const {
    const Vec3f normal = square_to_uniform_sphere(u);
    const Vec3f local = shape.to_local * normal;
    const Vec2f uv(turn(local.y, local.x), std::acos(std::clamp(local.z, -1.0f, 1.0f)) * inv_pi);
    return Place{shape.center + shape.radius * normal, shape.inwards ? -normal : normal, uv,
                 4 * pi * sqr(shape.radius), shape.radiance};
  }
  std::optional<Place> operator()(const DiskShape& shape) const {
    const Vec2f p = square_to_disk_concentric(u);
    return Place{shape.center + shape.axis_x * p.x + shape.axis_y * p.y,
                 shape.normal,
                 {glm::length(p), turn(p.y, p.x)},
                 pi * glm::length(glm::cross(shape.axis_x, shape.axis_y)),
                 shape.radiance};
  }
  std::optional<Place> operator()(const CylinderShape& shape) const {
    const float angle = 2 * pi * u.x;
    const Vec3f normal = shape.axis_x * std::cos(angle) + shape.axis_y * std::sin(angle);
    return Place{shape.base + shape.axis * (u.y * shape.length) + normal * shape.radius,
                 shape.inwards ? -normal : normal, u, 2 * pi * shape.radius * shape.length, shape.radiance};
  }
  template <typename Other>
  std::optional<Place> operator()(const Other&) const {
    return std::nullopt;
  }

  /// Angle of (x, y) as a share of a turn, in [0, 1).
  static float turn(float y, float x) {
    const float angle = std::atan2(y, x) * (0.5f * inv_pi);
    return angle < 0 ? angle + 1 : angle;
  }
};

Vec3f off_surface(const Place& place) {
  const Vec3f size = glm::abs(place.position);
  const float scale = max_component(size) + std::sqrt(place.area);
  return place.position + place.normal * (surface_offset * scale);
}

/// Cone that a point-like light sends light into: 1 - cosine of its half angle.
float one_minus_cos_cone(const PointShape& shape) {
  return shape.cutoff_angle >= pi ? 2.0f : 2 * sqr(std::sin(0.5f * shape.cutoff_angle));
}

}  // namespace

LightEmission::LightEmission(const World& world) : world_(world) {
  const scene::BoundingSphere& bounds = world.scene().bounds;
  center_ = bounds.center;
  radius_ = bounds.radius * margin;
  const auto count = static_cast<uint32_t>(world.lights().size());
  cumulative_.push_back(0);
  std::vector<double> powers;
  double total = 0;
  double shining = 0;  // lights
  for (uint32_t i = 0; i < count; ++i) {
    powers.push_back(static_cast<double>(power(world.lights().light(i))));
    total += powers.back();
    shining += powers.back() > 0 ? 1 : 0;
  }
  double sum = 0;
  for (const double power : powers) {
    if (power > 0) sum += even_share / shining + (1 - even_share) * power / total;
    cumulative_.push_back(static_cast<float>(sum));
  }
  for (uint32_t i = 0; i < count && count <= most_lights_asked; ++i) {
    std::optional<int32_t> medium;
    bool agree = true;
    for (int place = 0; place < places_a_side * places_a_side && agree; ++place) {
      const Vec2f u = (Vec2f(Vec2i(place % places_a_side, place / places_a_side)) + 0.5f) /
                      static_cast<float>(places_a_side);
      // The directions differ as well: through them light from infinity comes from all sides.
      const std::optional<EmittedRay> ray = sample_light(i, u, {u.y, u.x});
      if (!ray) continue;
      const int32_t found = world.medium_at(ray->origin);
      agree = !medium || *medium == found;
      medium = found;
    }
    medium_of_light_.push_back(agree ? medium : std::nullopt);
  }
}

float LightEmission::power(const Light& light) const {
  if (light.at_infinity()) return light.fluence(center_) * pi * sqr(radius_);
  const LightShape shape = light.shape();
  if (const auto* point = std::get_if<PointShape>(&shape))
    return light.bounds().intensity * 2 * pi * one_minus_cos_cone(*point);
  // A sphere's or a cylinder's `intensity` counts what is seen of it, which is not all of its area.
  const float area = std::visit(PlaceOnLight{{0.5f, 0.5f}}, shape)->area;
  const scene::Texture* radiance = std::visit(PlaceOnLight{{0.5f, 0.5f}}, shape)->radiance;
  return pi * area * luminance(radiance->mean());
}

int32_t LightEmission::medium_around(uint32_t light, const Vec3f& origin) const {
  if (light < medium_of_light_.size() && medium_of_light_[light]) return *medium_of_light_[light];
  return world_.medium_at(origin);
}

std::optional<EmittedRay> LightEmission::sample_light(uint32_t index, const Vec2f& u_place,
                                                      const Vec2f& u_direction) const {
  const Light& light = world_.lights().light(index);
  EmittedRay ray;
  if (light.at_infinity()) {
    const std::optional<LightSample> sample = light.sample(center_, u_direction);
    if (!sample || !(radius_ > 0)) return std::nullopt;
    const Frame frame = Frame::from_normal(sample->direction);
    const Vec2f p = square_to_disk_concentric(u_place);
    ray.direction = -sample->direction;
    ray.origin = center_ + radius_ * (sample->direction + frame.tangent * p.x + frame.bitangent * p.y);
    ray.flux = sample->radiance * (pi * sqr(radius_) / sample->pdf);
    return ray;
  }
  const LightShape shape = light.shape();
  if (const auto* point = std::get_if<PointShape>(&shape)) {
    const float cone = one_minus_cos_cone(*point);
    ray.origin = point->position;
    ray.direction = Frame::from_normal(point->axis).to_world(square_to_uniform_cone(u_direction, cone));
    // At distance 1 irradiance is what radiant intensity is.
    const std::optional<LightSample> sample = light.sample(ray.origin + ray.direction, u_place);
    if (!sample) return std::nullopt;
    ray.flux = sample->radiance * (sqr(sample->distance) * 2 * pi * cone);
    return ray;
  }
  const std::optional<Place> place = std::visit(PlaceOnLight{u_place}, shape);
  ray.origin = off_surface(*place);
  ray.direction = Frame::from_normal(place->normal).to_world(square_to_cosine_hemisphere(u_direction));
  ray.flux = place->radiance->evaluate(place->uv) * (pi * place->area);
  return ray;
}

std::optional<EmittedRay> LightEmission::sample(const EmissionPoint& u) const {
  const float total = cumulative_.back();
  if (!(total > 0)) return std::nullopt;
  const auto above = std::upper_bound(cumulative_.begin(), cumulative_.end(), u[0] * total);
  const auto light = static_cast<uint32_t>(std::max<std::ptrdiff_t>(above - cumulative_.begin() - 1, 0));
  if (light >= world_.lights().size()) return std::nullopt;
  const float probability = (cumulative_[light + 1] - cumulative_[light]) / total;
  std::optional<EmittedRay> ray = sample_light(light, {u[1], u[2]}, {u[3], u[4]});
  if (!ray || !(probability > 0)) return std::nullopt;
  ray->flux /= probability;
  ray->medium = medium_around(light, ray->origin);
  // Light from infinity gets through no unbounded medium.
  if (world_.lights().light(light).at_infinity() && ray->medium != scene::none)
    ray->flux *= transmittance(world_.medium(ray->medium).sigma_t, infinity);
  if (is_black(ray->flux) || !is_finite(ray->flux)) return std::nullopt;
  return ray;
}

}  // namespace fogbank::transport
