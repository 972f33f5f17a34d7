#include "derivatives/light_rays.h"

namespace fogbank::derivatives {

namespace {

/// Shadow rays stop short of the light by this share of their length, as World::visibility does.
constexpr double shadow_share = 1.0 - 1e-4;
/// More surfaces than this along one ray count as opaque: a guard against surfaces that coincide.
constexpr int most_passed_surfaces = 256;

}  // namespace

Ray LightRays::shadow_ray(const Vec3d& target, bool at_infinity) const {
  const double length = glm::length(target);
  Ray ray{x_, length > 0 ? Vec3f(target / length) : Vec3f(0, 0, 1), infinity};
  if (!at_infinity) ray.max_distance = static_cast<float>(length * shadow_share);
  return ray;
}

MediaPath LightRays::trace(const Ray& ray) const {
  const scene::Intersector& intersector = *world_.scene().intersector;
  int32_t medium = medium_;
  MediaPath path;
  if (medium != scene::none) path.sigma_t = world_.medium(medium).sigma_t;
  if (intersector.has_passing_surfaces()) {
    Ray rest = ray;
    double travelled = 0;
    for (int passed = 0;; ++passed) {
      scene::Hit hit;
      ++counters_.closest_hit;
      if (!intersector.intersect_passing(rest, hit)) break;
      const scene::SurfaceInteraction surface = world_.scene().interaction(rest, hit);
      const transport::ShadingPoint point = transport::World::shading_point(surface);
      path.surfaces *=
          world_.bsdf(surface.shape).null_transmission(point, point.frame.to_local(-ray.direction));
      if (path.blocked() || passed == most_passed_surfaces) {
        path.surfaces = Spectrum(0);
        return path;
      }
      travelled += hit.distance;
      const int32_t beyond = world_.medium_beyond(surface, ray.direction, medium);
      if (beyond != medium) {
        path.boundaries.push_back({Vec3d(ray.direction) * travelled, Vec3d(surface.geometric_normal),
                                   beyond == scene::none ? Spectrum(0) : world_.medium(beyond).sigma_t});
        medium = beyond;
      }
      rest.origin = surface.spawn_origin(ray.direction);
      if (std::isfinite(rest.max_distance)) rest.max_distance -= hit.distance;
      if (!(rest.max_distance > 0)) break;
    }
  }
  ++counters_.any_hit;
  if (intersector.occluded(ray)) path.surfaces = Spectrum(0);
  return path;
}

bool LightRays::first_opaque(Ray ray, float& distance) const {
  const scene::Intersector& intersector = *world_.scene().intersector;
  const Vec3f direction = ray.direction;
  distance = 0;
  for (int passed = 0; passed <= most_passed_surfaces; ++passed) {
    scene::Hit hit;
    ++counters_.closest_hit;
    if (!intersector.intersect(ray, hit)) return false;
    distance += hit.distance;
    if (!world_.scene().shapes[hit.shape].passes_light) return true;
    const scene::SurfaceInteraction surface = world_.scene().interaction(ray, hit);
    const transport::ShadingPoint point = transport::World::shading_point(surface);
    if (is_black(world_.bsdf(surface.shape).null_transmission(point, point.frame.to_local(-direction))))
      return true;
    ray.origin = surface.spawn_origin(direction);
    if (std::isfinite(ray.max_distance)) ray.max_distance -= hit.distance;
    if (!(ray.max_distance > 0)) return false;
  }
  return true;
}

void LightRays::trace(std::span<const Vec3d> targets, bool at_infinity, std::span<MediaPath> paths) const {
  for (size_t i = 0; i < targets.size(); ++i) paths[i] = trace(shadow_ray(targets[i], at_infinity));
}

void LightRays::visible(std::span<const Vec3d> targets, bool at_infinity, std::span<uint8_t> visible) const {
  const scene::Intersector& intersector = *world_.scene().intersector;
  for (size_t i = 0; i < targets.size(); ++i) {
    const Ray ray = shadow_ray(targets[i], at_infinity);
    if (intersector.has_passing_surfaces()) {
      visible[i] = trace(ray).blocked() ? 0 : 1;
    } else {
      ++counters_.any_hit;
      visible[i] = intersector.occluded(ray) ? 0 : 1;
    }
  }
}

double LightRays::blocker_distance(const Vec3d& target, bool at_infinity) const {
  float distance = 0;
  return first_opaque(shadow_ray(target, at_infinity), distance) ? distance
                                                                 : std::numeric_limits<double>::infinity();
}

}  // namespace fogbank::derivatives
