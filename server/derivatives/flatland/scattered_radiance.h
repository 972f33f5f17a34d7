// Multiple scattering by quadrature: the reference for the marches.
#pragma once

#include <vector>

#include "derivatives/flatland/source.h"
#include "derivatives/jet.h"

namespace fogbank::derivatives::flatland {

/// M_med of method.md section 1: 1 / (2 pi) int dtheta int ds T(s) sigma_s q(x + s omega) over what x sees,
/// with its gradient and Hessian. The integral is taken in cells between the directions of all points where
/// something changes (vertices, corners of the box, crossings of creases) and, along each ray, between the
/// creases. All these limits are jets, the nodes move with them, and a node's share is differentiated
/// exactly: no step of finite differences, no crease inside a cell. What remains is the error of
/// Gauss-Legendre quadrature; it is greatest where q is singular, at ends of lights and of occluders in the
/// light.
class ScatteredRadiance {
 public:
  /// Throws Error(resource_exhausted, "TOO_MANY_CREASES") above `largest_crease_count`: the cost of a point
  /// grows with their fourth power.
  ScatteredRadiance(const Scene& scene, const Source& source);

  Jet2d at(const Vec2d& x) const;

  /// Lines through 8 vertices: 4 segments.
  static constexpr size_t largest_crease_count = 28;

 private:
  class View;

  const Scene& scene_;
  const Source& source_;
  std::vector<Line> creases_;
  std::vector<Vec2d> events_;
};

}  // namespace fogbank::derivatives::flatland
