#include "derivatives/sphere_rays.h"

#include <algorithm>
#include <cmath>

namespace fogbank::derivatives {

namespace {

/// Mirrors that one line is followed through; beyond them a mirror's image counts as lying on it.
constexpr size_t most_mirrors = 8;

Vec3f mirrored(const Vec3f& v, const Vec3f& normal) { return v - 2 * glm::dot(v, normal) * normal; }

}  // namespace

uint32_t surface_number(const scene::Hit& hit, const Vec3f& normal) {
  const Vec3f size = glm::abs(normal);
  const int axis = size.x > size.y ? (size.x > size.z ? 0 : 2) : (size.y > size.z ? 1 : 2);
  const uint32_t side = static_cast<uint32_t>(2 * axis) + (normal[axis] < 0 ? 1u : 0u);
  const uint32_t shape = hit.shape + 0x9e3779b9u * static_cast<uint32_t>(hit.instance + 1);
  return std::min(shape * 6 + side, RayEnd::nothing - 1);
}

bool SphereRays::is_mirror(uint32_t shape) const {
  const transport::Bsdf& bsdf = lines_.world().bsdf(shape);
  // Nothing but delta lobes, and none of them to the other side: a smooth conductor.
  return plan_.mirrors() && !bsdf.has_smooth_lobes() && !bsdf.transmits() &&
         !is_black(bsdf.albedo_estimate());
}

void SphereRays::trace(const Vec3f& x, int32_t medium, int32_t n, RandomStream& random,
                       RayCounters& counters) {
  topology_ = DirectionTopology::of(n, counters);
  hits_.clear();
  rays_of_hits_.clear();
  lines_.start(x, medium);
  const std::vector<Vec3f> directions = stratified_directions(*topology_, random, counters);
  constexpr float anywhere = infinity;
  lines_.append(directions, {&anywhere, 1}, counters, &random);

  const transport::LightSampler& lights = lines_.world().lights();
  const bool reflected = plan_.reflected() || plan_.mirrors();
  ends_.assign(lines_.size(), {});
  for (size_t ray = 0; ray < ends_.size(); ++ray) {
    counters.poll_at(ray);
    RayEnd& end = ends_[ray];
    end.distance = lines_.distance(ray);
    end.weight = lines_.transmittance(ray, end.distance);
    if (!lines_.is_blocked(ray)) {
      for (const uint32_t light : lines_.world().environments())
        if (plan_.treatment(light) == transport::LightTreatment::sphere_grid)
          end.emitted += lights.light(light).emitted(lines_.direction(ray), nullptr);
      continue;
    }
    const scene::SurfaceInteraction surface = lines_.surface(ray);
    end.normal = surface.geometric_normal;
    end.surface = surface_number(lines_.hit(ray), surface.geometric_normal);
    if (!reflected) continue;
    hits_.push_back(
        {surface, lines_.direction(ray), lines_.last_medium(ray), std::max(luminance(end.weight), 0.0f)});
    rays_of_hits_.push_back(static_cast<uint32_t>(ray));
    if (is_mirror(surface.shape)) follow_mirrors(ray, surface, random, counters);
  }
}

void SphereRays::follow_mirrors(size_t ray, scene::SurfaceInteraction surface, RandomStream& random,
                                RayCounters& counters) {
  const transport::World& world = lines_.world();
  RayEnd& end = ends_[ray];
  Vec3f direction = lines_.direction(ray);
  int32_t medium = lines_.last_medium(ray);
  std::vector<Vec3f> normals;
  Sightlines piece(world);
  while (normals.size() < most_mirrors && is_mirror(surface.shape)) {
    const transport::ShadingPoint point = transport::World::shading_point(surface);
    const float u = random.next_float();
    const std::optional<transport::BsdfSample> sample =
        world.bsdf(surface.shape).sample(point, point.frame.to_local(-direction), u, random.next_vec2());
    if (!sample || !sample->delta) return;
    normals.push_back(surface.shading_normal);
    direction = glm::normalize(point.frame.to_world(sample->wi));
    medium = world.medium_beyond(surface, direction, medium);
    piece.start(surface.spawn_origin(direction), medium);
    constexpr float anywhere = infinity;
    piece.append({&direction, 1}, {&anywhere, 1}, counters, &random);
    medium = piece.last_medium(0);
    end.is_mirrored = true;
    end.distance += piece.distance(0);
    if (!piece.is_blocked(0)) {
      end.normal = Vec3f(0);
      end.surface = RayEnd::nothing;
      return;
    }
    surface = piece.surface(0);
    end.normal = surface.geometric_normal;
    for (auto normal = normals.rbegin(); normal != normals.rend(); ++normal)
      end.normal = mirrored(end.normal, *normal);
    end.surface = surface_number(piece.hit(0), end.normal);
  }
}

}  // namespace fogbank::derivatives
