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
/// Media that light from infinity is aimed at, besides the whole scene, where a target's cross-section is at
/// most this share of the scene's; larger ones gain little. Of more media than `most_targets` none is.
constexpr size_t most_targets = 16;
constexpr float most_target_share = 0.5f;
/// Part of the choice of a target that doesn't follow its cross-section.
constexpr double even_share_of_targets = 0.5;
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

/// Spheres around the boxes of small media that scatter, smallest first, and the one around the scene.
std::vector<scene::BoundingSphere> targets_of(const World& world) {
  scene::BoundingSphere all = world.scene().bounds;
  all.radius *= margin;
  std::vector<scene::BoundingSphere> targets;
  for (size_t i = 0; i < world.scene().media.size(); ++i) {
    const MediumInfo& medium = world.medium(static_cast<int32_t>(i));
    if (is_black(medium.sigma_s)) continue;
    const scene::BoundingSphere ball{0.5f * (medium.extent.lower + medium.extent.upper),
                                     0.5f * margin * glm::length(medium.extent.upper - medium.extent.lower)};
    // Neither media without a boundary, nor with an edge or less of one.
    if (ball.radius > 0 && sqr(ball.radius) <= most_target_share * sqr(all.radius)) targets.push_back(ball);
  }
  std::stable_sort(targets.begin(), targets.end(),
                   [](const auto& a, const auto& b) { return a.radius < b.radius; });
  if (targets.size() > most_targets) targets.clear();
  targets.push_back(all);
  return targets;
}

}  // namespace

LightEmission::LightEmission(const World& world) : world_(world), targets_(targets_of(world)) {
  const auto count = static_cast<uint32_t>(world.lights().size());
  std::vector<double> powers;
  double total = 0;
  double shining = 0;  // lights
  for (uint32_t i = 0; i < count; ++i) {
    powers.push_back(static_cast<double>(power(world.lights().light(i))));
    total += powers.back();
    shining += powers.back() > 0 ? 1 : 0;
  }
  double area = 0;  // of all targets, over pi
  for (const scene::BoundingSphere& target : targets_) area += sqr(static_cast<double>(target.radius));
  double sum = 0;
  cumulative_.push_back(0);
  for (uint32_t light = 0; light < count; ++light) {
    if (!(powers[light] > 0)) continue;
    const double share = even_share / shining + (1 - even_share) * powers[light] / total;
    const size_t parts = world.lights().light(light).at_infinity() ? targets_.size() : 1;
    for (uint32_t target = 0; target < parts; ++target) {
      double part = 1;
      if (parts > 1) {
        part = even_share_of_targets / static_cast<double>(parts) +
               (1 - even_share_of_targets) * sqr(static_cast<double>(targets_[target].radius)) / area;
      }
      sum += share * part;
      choices_.push_back({light, target});
      cumulative_.push_back(static_cast<float>(sum));
    }
  }
  if (sum > 0) cumulative_.back() = 1;
  for (uint32_t i = 0; i < count && count <= most_lights_asked; ++i) {
    std::optional<int32_t> medium;
    bool agree = true;
    for (int place = 0; place < places_a_side * places_a_side && agree; ++place) {
      const Vec2f u = (Vec2f(Vec2i(place % places_a_side, place / places_a_side)) + 0.5f) /
                      static_cast<float>(places_a_side);
      // The directions differ as well: through them light from infinity comes from all sides.
      const std::optional<EmittedRay> ray =
          sample_choice({i, static_cast<uint32_t>(targets_.size() - 1)}, u, {u.y, u.x});
      if (!ray) continue;
      const int32_t found = world.medium_at(ray->origin);
      agree = !medium || *medium == found;
      medium = found;
    }
    medium_of_light_.push_back(agree ? medium : std::nullopt);
  }
}

float LightEmission::power(const Light& light) const {
  if (light.at_infinity()) {
    const scene::BoundingSphere& all = targets_.back();
    return light.fluence(all.center) * pi * sqr(all.radius);
  }
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

bool LightEmission::is_of_target(const Vec3f& origin, const Vec3f& direction, uint32_t target) const {
  return std::none_of(targets_.begin(), targets_.begin() + target, [&](const scene::BoundingSphere& other) {
    const Vec3f offset = other.center - origin;
    const Vec3f across = offset - direction * glm::dot(offset, direction);
    return glm::dot(across, across) < sqr(other.radius);
  });
}

std::optional<EmittedRay> LightEmission::sample_choice(const Choice& choice, const Vec2f& u_place,
                                                       const Vec2f& u_direction) const {
  const Light& light = world_.lights().light(choice.light);
  EmittedRay ray;
  if (light.at_infinity()) {
    const scene::BoundingSphere& all = targets_.back();
    const scene::BoundingSphere& target = targets_[choice.target];
    const std::optional<LightSample> sample = light.sample(all.center, u_direction);
    if (!sample || !(all.radius > 0)) return std::nullopt;
    const Frame frame = Frame::from_normal(sample->direction);
    const Vec2f p = square_to_disk_concentric(u_place);
    const Vec3f place = target.center + target.radius * (frame.tangent * p.x + frame.bitangent * p.y);
    ray.direction = -sample->direction;
    if (!is_of_target(place, ray.direction, choice.target)) return std::nullopt;
    // On the plane that touches the sphere around the scene.
    ray.origin = place + sample->direction * (all.radius - glm::dot(place - all.center, sample->direction));
    ray.flux = sample->radiance * (pi * sqr(target.radius) / sample->pdf);
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
  if (dark()) return std::nullopt;
  const auto above = std::upper_bound(cumulative_.begin(), cumulative_.end(), u[0]);
  const auto index = static_cast<size_t>(std::max<std::ptrdiff_t>(above - cumulative_.begin() - 1, 0));
  if (index >= choices_.size()) return std::nullopt;
  const Choice& choice = choices_[index];
  const float probability = cumulative_[index + 1] - cumulative_[index];
  std::optional<EmittedRay> ray = sample_choice(choice, {u[1], u[2]}, {u[3], u[4]});
  if (!ray || !(probability > 0)) return std::nullopt;
  ray->flux /= probability;
  ray->medium = medium_around(choice.light, ray->origin);
  // Light from infinity gets through no unbounded medium.
  if (world_.lights().light(choice.light).at_infinity() && ray->medium != scene::none)
    ray->flux *= transmittance(world_.medium(ray->medium).sigma_t, infinity);
  if (is_black(ray->flux) || !is_finite(ray->flux)) return std::nullopt;
  return ray;
}

}  // namespace fogbank::transport
