// What a record of the two-dimensional cache knows of the geometry around it: the guards that derivatives
// can't replace (method.md section 10.4).
#pragma once

#include <array>
#include <cmath>
#include <limits>
#include <numbers>

#include "derivatives/flatland/ring.h"
#include "derivatives/flatland/scene.h"

namespace fogbank::cache::flatland {

/// Distance to the nearest surface in each of equal angles (guard 4).
class DepthBins {
 public:
  static constexpr int count = 64;

  DepthBins() { distances_.fill(std::numeric_limits<double>::infinity()); }
  explicit DepthBins(const derivatives::flatland::Ring& ring);

  /// Whether an offset from the record stays in front of what it saw in that direction.
  bool reaches(const Vec2d& offset) const {
    const double distance = glm::length(offset);
    return distance == 0 || distance < distances_[bin(std::atan2(offset.y, offset.x))];
  }

 private:
  static size_t bin(double angle) {
    const double turns = angle / (2 * std::numbers::pi);
    return static_cast<size_t>((turns - std::floor(turns)) * count) % count;
  }

  std::array<double, count> distances_{};
};

/// Distance in which no light of the scene changes its visibility, as far as the ring's rays tell; infinite
/// where they tell of no change, and for lights that are seen in part, whose change the derivatives see.
///   Blockers: distance to the line through a blocker's point V and the light's nearest end E, with L = |E|,
///   l = |V| and gamma between them (ratio-records.md section 2),
///     R <= l L sin(gamma) / |E - V|,   sin -> 1 beyond 90 degrees,   only if l cos(gamma) < L,
///   of a light seen as a whole over the rays that hit blockers; of a light that is hidden over the last rays
///   that hit what hides it. (ratio-records.md takes the nearest hit inside the light's cone for the latter:
///   an edge outside of the cone may be nearer, and then the margin is too long.) gamma is less the gap to
///   the next ray towards the light: a blocker may reach as far. Where two blockers hide a light together,
///   that a gap opens between them is not foreseen. The light itself: both its sides shine, and M has a kink
///   on its line beyond its ends, where one disappears as the other comes to light.
double visibility_margin(const derivatives::flatland::Scene& scene, const derivatives::flatland::Ring& ring,
                         const Vec2d& x);

struct Surroundings {
  DepthBins depth;
  double visibility_margin = std::numeric_limits<double>::infinity();
};

}  // namespace fogbank::cache::flatland
