// Who watches what a camera path asks the cache.
#pragma once

#include "cache/index.h"
#include "cache/record_maker.h"

namespace fogbank::integrators {

/// A look-up that a camera path makes.
struct LookUp {
  cache::Wish place;
  cache::Interpolation found;
  Spectrum weight{0};      ///< of the place's radiance in the pixel
  Vec3f direction{0};      ///< of the ray through a medium; 0 on a surface
  float behind = 0;        ///< distance to where the ray's segment begins
  float ahead = infinity;  ///< and to the surface that ends it
  /// How far a record here may reach at most, going by those that were found along the same ray: no farther
  /// than theirs and the way to them (neighbour clamping). Infinite where there are none.
  float reach = infinity;
  /// What becomes of records with a shape, as long as the observer is told; null on surfaces.
  const cache::ScatteredDirection* scattered = nullptr;
  /// What recovered the records behind `found`, if the index alone has none; lives as long as the call.
  const cache::VisibilityTest* visibility = nullptr;
};

/// The records behind `look_up.found`, of the index that was asked.
std::vector<cache::Contribution> contributions_to(const LookUp& look_up, const cache::Index& index);

class LookUpObserver {
 public:
  virtual ~LookUpObserver() = default;
  virtual void look_up(const LookUp& look_up) = 0;
};

}  // namespace fogbank::integrators
