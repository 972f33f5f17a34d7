#include "cache/ray_visibility.h"

namespace fogbank::cache {

namespace {

/// Rays end before their point, which may lie on a surface, by this share of their length.
constexpr float before_point = 1e-3f;
/// On surfaces they run above them, by this share of the scene's radius.
constexpr float above_surface = 1e-4f;

}  // namespace

bool RayVisibility::reaches(const Vec3f& place, const Vec3f& normal, const Vec3f& point) const {
  const Vec3f offset = point - place;
  const float distance = glm::length(offset);
  if (!(distance > 0)) return true;
  const Vec3f origin = place + above_surface * scene_.bounds.radius * normal;
  ++counters_.any_hit;
  return !scene_.intersector->occluded({origin, offset / distance, (1 - before_point) * distance});
}

}  // namespace fogbank::cache
