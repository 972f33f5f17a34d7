// Direct light of an emitter with a surface, with visibility resolved to rounding: a reference that shares
// nothing with the triangulation.
#pragma once

#include "derivatives/light_surface.h"
#include "transport/plan.h"

namespace fogbank::derivatives {

/// How finely a light is searched and integrated.
struct VisibilityPrecision {
  /// Places on each scan line that are asked for visibility. A blocker that lies between two may be missed; a
  /// gap between two blockers is found.
  int32_t places = 48;
  /// Of the result, for the integral over scan lines.
  double tolerance = 1e-6;
  /// Scan lines at most: outlines with many corners use them up.
  int32_t most_lines = 1000;
};

/// 1/(4 pi) times the integral of L T cos / l^2 over the part of light `light` that x sees, per channel.
/// Each line of constant v is cut where visibility changes, by bisection to rounding; Gauss-Kronrod
/// quadrature of 15 points on every visible piece, and adaptively over the lines. x is used in single
/// precision for rays, so it should be representable. 0 for lights without a surface.
Vec3d exact_direct_light(const transport::World& world, const transport::Plan& plan, uint32_t light,
                         const Vec3d& x, int32_t medium, const VisibilityPrecision& precision,
                         RayCounters& counters);

}  // namespace fogbank::derivatives
