// Where, between two neighbouring lines of sight that end at different depths, the nearer surface's outline
// lies: silhouette bisection (method.md section 6.2).
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "derivatives/sphere_rays.h"

namespace fogbank::derivatives {

/// A point of an outline, between two lines of a direction grid.
struct Outline {
  uint32_t near = 0;  ///< the line that ends on the surface whose outline it is
  uint32_t far = 0;
  Vec3f direction{0, 0, 1};       ///< unit; in which both of the following are seen
  float near_distance = 0;        ///< of the outline itself
  float far_distance = infinity;  ///< of what is seen just past it; infinity: the environment
};

/// The outlines on the edges of one trace of a grid.
struct Outlines {
  std::vector<Outline> points;
  std::vector<uint32_t> of_edge;  ///< for each edge its place in `points`, `none` or `unknown`

  static constexpr uint32_t none = 0xffffffff;     ///< the ends lie on surfaces that meet
  static constexpr uint32_t unknown = 0xfffffffe;  ///< a jump in depth that was not bisected
};

/// Looks at each of `edges`, whose vertices are lines with their `ends`, and bisects jumps in depth `steps`
/// times, at most `most` of them: first those that move most light as the point moves, by the difference of
/// `weights` (one a ray, >= 0: radiance times transmittance) times that of the inverse distances. Jumps
/// between weights that differ by less than 1 % never are, nor are those at the frame of a mirror.
Outlines find_outlines(const Sightlines& lines, std::span<const RayEnd> ends,
                       std::span<const DirectionTopology::Edge> edges, std::span<const float> weights,
                       int32_t steps, size_t most, RayCounters& counters);

}  // namespace fogbank::derivatives
