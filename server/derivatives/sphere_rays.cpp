#include "derivatives/sphere_rays.h"

#include <algorithm>
#include <cmath>

namespace fogbank::derivatives {

namespace {

/// Mirrors that one line is followed through; beyond them a mirror's image counts as lying on it.
constexpr size_t most_mirrors = 8;
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

/// How far an end lies behind (positive) or before another's tangent plane along its own line.
struct PlaneOffset {
  bool is_small = false;
  bool is_before = false;
};

/// Of the end `b` and the plane at `a`. Planes that the line doesn't meet count as infinitely far away.
PlaneOffset offset_from_plane(const Vec3f& direction_a, const RayEnd& a, const Vec3f& direction_b,
                              const RayEnd& b) {
  const float here = glm::dot(a.normal, direction_a);
  const float there = glm::dot(a.normal, direction_b);
  if (!(here * there > 0)) return {false, true};
  // b.distance - a.distance here / there, times |there|.
  const float offset = std::copysign(1.0f, there) * (b.distance * there - a.distance * here);
  return {std::fabs(offset) <= flatness * b.distance * std::fabs(there), offset < 0};
}

}  // namespace

bool surfaces_meet(const Vec3f& direction_a, const RayEnd& a, const Vec3f& direction_b, const RayEnd& b) {
  const bool a_ends = std::isfinite(a.distance);
  const bool b_ends = std::isfinite(b.distance);
  if (!a_ends || !b_ends) return a_ends == b_ends;
  if (a.is_mirrored != b.is_mirrored) return false;
  const PlaneOffset of_b = offset_from_plane(direction_a, a, direction_b, b);
  const PlaneOffset of_a = offset_from_plane(direction_b, b, direction_a, a);
  if (of_a.is_small && of_b.is_small) return true;
  // At an edge or in a corner both ends lie on the same side of the other's tangent plane; across a jump the
  // far one lies behind the near one's and the near one before the far one's.
  return of_a.is_before == of_b.is_before &&
         std::max(a.distance, b.distance) <= greatest_step * std::min(a.distance, b.distance);
}

bool SphereRays::is_mirror(uint32_t shape) const {
  const transport::Bsdf& bsdf = lines_.world().bsdf(shape);
  // Nothing but delta lobes, and none of them to the other side: a smooth conductor.
  return plan_.mirrors() && !bsdf.has_smooth_lobes() && !bsdf.transmits() &&
         !is_black(bsdf.albedo_estimate());
}

void SphereRays::trace(const Vec3f& x, int32_t medium, int32_t n, RandomStream& random,
                       RayCounters& counters) {
  topology_ = DirectionTopology::of(n);
  hits_.clear();
  rays_of_hits_.clear();
  lines_.start(x, medium);
  const std::vector<Vec3f> directions = stratified_directions(*topology_, random);
  constexpr float anywhere = infinity;
  lines_.append(directions, {&anywhere, 1}, counters, &random);

  const transport::LightSampler& lights = lines_.world().lights();
  const bool reflected = plan_.reflected() || plan_.mirrors();
  ends_.assign(lines_.size(), {});
  for (size_t ray = 0; ray < ends_.size(); ++ray) {
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
