// Terms that both triangulated sums, over surfaces and over the medium, are made of.
#pragma once

#include <numbers>

#include "derivatives/flatland/ring.h"
#include "derivatives/segment_form_factor.h"

namespace fogbank::derivatives::flatland {

/// Form factor of the segment between two points relative to x, counter-clockwise.
inline Jet2d form_factor(const Vec2d& from, const Vec2d& to) {
  return segment_form_factor_jet<double>(from, to, to - from);
}

/// What a slanted segment adds when its weight is extended linearly beyond the silhouette: the far point
/// slides as x moves (method.md section 6.4 a). `slope` is the weight's derivative by angle, into the far
/// side.
inline Jet2d sliding_term(double slope, const Jet2d& factor) {
  return factor * factor * (-std::numbers::pi * slope);
}

/// Derivative of the distance to a line by angle, counter-clockwise: -d (u_perp . n) / (u . n).
inline double distance_slope(const Hit& hit, const Vec2d& direction, const Line& line) {
  const Vec2d turned(-direction.y, direction.x);
  return -hit.distance * glm::dot(turned, line.normal) / glm::dot(direction, line.normal);
}

}  // namespace fogbank::derivatives::flatland
