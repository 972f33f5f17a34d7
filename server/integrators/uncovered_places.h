// Where camera rays want records.
#pragma once

#include <utility>
#include <vector>

#include "cache/thinning.h"
#include "integrators/look_up_observer.h"

namespace fogbank::integrators {

/// Spacing of a round's records, in radii that they are thought to have: spheres of that radius cover what
/// lies within the spacing with a weight of 0.05 at least.
inline constexpr float spacing_share = 0.85f;
/// A look-up of less weight counts as uncovered: right at the border of an extent the next pixel may be out.
inline constexpr float least_weight = 0.02f;

/// Collects the look-ups of a few camera rays that want a record.
class UncoveredPlaces final : public LookUpObserver {
 public:
  /// `default_reach`: of a record where nothing around tells, scene units.
  explicit UncoveredPlaces(float default_reach) : default_reach_(default_reach) {}

  void look_up(const LookUp& look_up) override;
  /// Surface records go by the reach of those that neighbouring rays met.
  std::vector<cache::SpacedWish> places() &&;

 private:
  float default_reach_;
  std::vector<cache::SpacedWish> places_;
  std::vector<cache::Wish> on_surfaces_;
  std::vector<std::pair<cache::Wish, float>> covered_;  ///< on surfaces, with radii
};

}  // namespace fogbank::integrators
