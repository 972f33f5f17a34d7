#include "derivatives/sphere_rays.h"

#include <algorithm>
#include <cmath>

namespace fogbank::derivatives {

namespace {

/// Mirrors that one line is followed through; beyond them mirrors are surfaces as others are.
constexpr uint8_t most_mirrors = 8;
/// Neighbouring ends this close to each other's tangent planes, as a share of the distance, are on one
/// surface.
constexpr float flatness = 0.02f;
/// A jump in depth by more than this factor is none of two surfaces that meet.
constexpr float greatest_step = 1.5f;

/// Number of a surface's side that faces one of the six directions of the axes.
uint32_t surface_number(const scene::Hit& hit, const Vec3f& normal) {
  const Vec3f size = glm::abs(normal);
  const int axis = size.x > size.y ? (size.x > size.z ? 0 : 2) : (size.y > size.z ? 1 : 2);
  const uint32_t side = static_cast<uint32_t>(2 * axis) + (normal[axis] < 0 ? 1u : 0u);
  const uint32_t shape = hit.shape + 0x9e3779b9u * static_cast<uint32_t>(hit.instance + 1);
  return std::min(shape * 6 + side, RayEnd::nothing - 1);
}

Vec3f mirrored(const Vec3f& v, const Vec3f& normal) { return v - 2 * glm::dot(v, normal) * normal; }

/// Distance along `direction` of the tangent plane at an end in `at`; infinite where it isn't met.
float plane_distance(const Vec3f& at, const RayEnd& end, const Vec3f& direction) {
  const float here = glm::dot(end.normal, at);
  const float there = glm::dot(end.normal, direction);
  return here * there > 0 ? end.distance * (here / there) : infinity;
}

}  // namespace

bool surfaces_meet(const Vec3f& direction_a, const RayEnd& a, const Vec3f& direction_b, const RayEnd& b) {
  const bool a_ends = std::isfinite(a.distance);
  const bool b_ends = std::isfinite(b.distance);
  if (!a_ends || !b_ends) return a_ends == b_ends;
  if (a.mirrors != b.mirrors) return false;
  const float beyond_a = b.distance - plane_distance(direction_a, a, direction_b);
  const float beyond_b = a.distance - plane_distance(direction_b, b, direction_a);
  if (std::fabs(beyond_a) <= flatness * b.distance && std::fabs(beyond_b) <= flatness * a.distance)
    return true;
  // At an edge or in a corner both tangent planes pass on the same side of the other end; across a jump the
  // near one passes before it and the far one behind.
  const bool same_side = (beyond_a < 0) == (beyond_b < 0);
  return same_side && std::max(a.distance, b.distance) <= greatest_step * std::min(a.distance, b.distance);
}

bool SphereRays::is_mirror(uint32_t shape) const {
  const transport::Bsdf& bsdf = lines_.world().bsdf(shape);
  // Nothing but delta lobes, and none of them to the other side: a smooth conductor.
  return plan_.mirrors() && !bsdf.has_smooth_lobes() && !bsdf.transmits() &&
         !is_black(bsdf.albedo_estimate());
}

Spectrum SphereRays::environment(const Vec3f& direction, bool mirrored) const {
  Spectrum sum(0);
  for (const uint32_t light : lines_.world().environments()) {
    if (mirrored || plan_.treatment(light) == transport::LightTreatment::sphere_grid)
      sum += lines_.world().lights().light(light).emitted(direction, nullptr);
  }
  return sum;
}

RayEnd SphereRays::end_of(const Sightlines& lines, size_t line) {
  RayEnd end;
  end.distance = lines.distance(line);
  if (!lines.is_blocked(line)) return end;
  const scene::SurfaceInteraction surface = lines.surface(line);
  end.normal = surface.geometric_normal;
  end.surface = surface_number(lines.hit(line), surface.geometric_normal);
  return end;
}

void SphereRays::add_hit(size_t ray, const scene::SurfaceInteraction& surface, const Vec3f& direction,
                         int32_t medium) {
  ends_[ray].hit = static_cast<uint32_t>(hits_.size());
  hits_.push_back({surface, direction, medium, std::max(luminance(ends_[ray].weight), 0.0f)});
}

void SphereRays::trace(const Vec3f& x, int32_t medium, int32_t n, int32_t max_depth, RandomStream& random,
                       RayCounters& counters) {
  topology_ = DirectionTopology::of(n);
  hits_.clear();
  hits_up_to_.clear();
  lines_.start(x, medium);
  const std::vector<Vec3f> directions = stratified_directions(*topology_, random);
  constexpr float anywhere = infinity;
  lines_.append(directions, {&anywhere, 1}, counters, &random);

  const bool reflected = plan_.reflected() || plan_.mirrors();
  ends_.assign(lines_.size(), {});
  std::vector<Mirrored> mirrors;
  for (size_t ray = 0; ray < ends_.size(); ++ray) {
    RayEnd& end = ends_[ray];
    end.distance = lines_.distance(ray);
    end.weight = lines_.transmittance(ray, end.distance);
    if (!lines_.is_blocked(ray)) {
      if (plan_.constant_environment()) end.emitted = environment(lines_.direction(ray), false);
      continue;
    }
    const scene::SurfaceInteraction surface = lines_.surface(ray);
    end.normal = surface.geometric_normal;
    end.surface = surface_number(lines_.hit(ray), surface.geometric_normal);
    if (!reflected) continue;
    if (is_mirror(surface.shape)) {
      mirrors.push_back({ray, surface, lines_.direction(ray), lines_.last_medium(ray), {}});
    } else {
      add_hit(ray, surface, lines_.direction(ray), lines_.last_medium(ray));
    }
  }
  hits_up_to_.push_back(hits_.size());
  // Camera, x, mirrors, light: each mirror is an edge more.
  for (uint8_t count = 1; !mirrors.empty(); ++count) {
    std::vector<Mirrored> further;
    const bool light_in_reach = max_depth < 0 || max_depth >= 2 + count;
    for (Mirrored& path : mirrors) {
      ends_[path.ray].mirrors = count;
      if (light_in_reach) follow(path, further, random, counters);
    }
    mirrors = std::move(further);
    hits_up_to_.push_back(hits_.size());
  }
}

void SphereRays::follow(Mirrored& path, std::vector<Mirrored>& further, RandomStream& random,
                        RayCounters& counters) {
  const transport::World& world = lines_.world();
  RayEnd& end = ends_[path.ray];
  const transport::ShadingPoint point = transport::World::shading_point(path.surface);
  const float u = random.next_float();
  const std::optional<transport::BsdfSample> sample =
      world.bsdf(path.surface.shape)
          .sample(point, point.frame.to_local(-path.direction), u, random.next_vec2());
  if (!sample || !sample->delta) {
    end.weight = Spectrum(0);
    return;
  }
  end.weight *= sample->weight;
  const Vec3f direction = glm::normalize(point.frame.to_world(sample->wi));
  path.normals.push_back(path.surface.shading_normal);
  const int32_t medium = world.medium_beyond(path.surface, direction, path.medium);

  Sightlines next(world);
  next.start(path.surface.spawn_origin(direction), medium);
  constexpr float anywhere = infinity;
  next.append({&direction, 1}, {&anywhere, 1}, counters, &random);
  end.weight *= next.transmittance(0, next.distance(0));
  end.distance += next.distance(0);
  if (!next.is_blocked(0)) {
    end.normal = Vec3f(0);
    end.surface = RayEnd::nothing;
    end.emitted = environment(direction, true);
    return;
  }
  const scene::SurfaceInteraction surface = next.surface(0);
  end.normal = surface.geometric_normal;
  for (auto normal = path.normals.rbegin(); normal != path.normals.rend(); ++normal)
    end.normal = mirrored(end.normal, *normal);
  end.surface = surface_number(next.hit(0), end.normal) ^ (0x85ebca6bu * end.mirrors);
  if (is_mirror(surface.shape) && end.mirrors < most_mirrors) {
    further.push_back({path.ray, surface, direction, next.last_medium(0), std::move(path.normals)});
    return;
  }
  const uint32_t light = world.light_of_hit(surface.shape, surface.primitive);
  if (light != transport::SceneLights::no_light)
    end.emitted = world.lights().light(light).emitted(direction, &surface);
  add_hit(path.ray, surface, direction, next.last_medium(0));
}

}  // namespace fogbank::derivatives
