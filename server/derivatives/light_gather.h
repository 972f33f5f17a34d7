// Direct light at a point of a medium from everything that emits, with derivatives that see what blocks it.
#pragma once

#include "derivatives/delta_lights.h"
#include "derivatives/estimator.h"
#include "derivatives/light_grid.h"

namespace fogbank::derivatives {

/// Every light that the plan treats by closed form or by a grid is counted here once, by its emission alone;
/// constant environments are the sphere grid's. Lights with an extent have a grid of their own (method.md
/// section 7) with silhouettes bisected if `settings.bisect`. Blockers that none of a grid's rays meets are
/// missed: cells per side are `light_cells(settings.samples)`. Immutable; serves all threads.
class LightGather {
 public:
  /// Throws nothing. `world` and `plan` must outlive it.
  LightGather(const transport::World& world, const transport::Plan& plan, const EstimatorSettings& settings);

  /// Adds mean incoming radiance at `x`, a point inside `medium` (scene::none: vacuum). Finite for all finite
  /// x; draws only from `random`.
  void add(const Vec3f& x, int32_t medium, RandomStream& random, RadianceJet& sum,
           RayCounters& counters) const;

 private:
  const transport::World& world_;
  const transport::Plan& plan_;
  EstimatorSettings settings_;
  double far_distance_;
  std::vector<PlannedLight> lights_;
  DeltaLights delta_lights_;
};

/// Cells along a side of a light's grid: a quarter of the side of the sphere grid, at least 2 (method.md
/// section 17: 1024 directions go with 8 x 8 cells, 81 rays and some 8 for each cell that an outline
/// crosses).
int32_t light_cells(int32_t samples);

}  // namespace fogbank::derivatives
