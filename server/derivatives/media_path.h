// Transmittance along a straight line that crosses media, with derivatives with respect to its start.
#pragma once

#include <vector>

#include "core/vector.h"
#include "derivatives/radiance_jet.h"

namespace fogbank::derivatives {

/// What lies between a point x and a target: media one after the other, and surfaces that pass light straight
/// on. Boundaries count as planes, so their curvature is missing from Hessians.
struct MediaPath {
  struct Boundary {
    Vec3d position{0};  ///< relative to x
    Vec3d normal{0};
    Spectrum sigma_t{0};  ///< beyond it
  };

  Spectrum surfaces{1};  ///< product of what the surfaces pass; black: blocked
  Spectrum sigma_t{0};   ///< around x
  std::vector<Boundary> boundaries;

  bool blocked() const { return is_black(surfaces); }
  /// One medium all the way.
  bool uniform() const { return boundaries.empty(); }

  /// Transmittance (surfaces included) from x to the fixed point x + r as x moves; r may be another target
  /// than the one that was traced, as long as it lies behind the same boundaries.
  RadianceJet towards(const Vec3d& r) const;
  /// The same towards infinity in a fixed direction (method.md section 7, "Misses"): 0 where the last medium
  /// absorbs.
  RadianceJet towards_infinity(const Vec3d& direction) const;
};

}  // namespace fogbank::derivatives
