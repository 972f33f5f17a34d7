// The directions around a point, sorted, and what lies there.
#pragma once

#include <vector>

#include "derivatives/flatland/scene.h"

namespace fogbank::derivatives::flatland {

struct Sight {
  double angle = 0;
  Vec2d direction{1, 0};
  Hit hit;
  bool stratified = true;  ///< one of the strata's rays, not a bisection's

  /// Of the hit, relative to the point.
  Vec2d offset() const { return direction * hit.distance; }
};

struct Ring {
  std::vector<Sight> sights;  ///< counter-clockwise; the last one's neighbour is the first
  uint64_t rays = 0;

  const Sight& after(size_t i) const { return sights[i + 1 < sights.size() ? i + 1 : 0]; }
  const Sight& before(size_t i) const { return sights[i > 0 ? i - 1 : sights.size() - 1]; }
};

/// One direction in each of `samples` equal strata. Gaps between different surfaces, one of them a segment,
/// are bisected `bisections` times: the last direction that sees the one and the first that does not are
/// added (method.md section 6.2); again from there, where a third surface comes to light. The random numbers
/// depend on (seed, x) only, so that points may be asked in any order.
Ring make_ring(const Scene& scene, const Vec2d& x, int samples, int bisections, uint64_t seed);

}  // namespace fogbank::derivatives::flatland
