// Light at a point estimated with random numbers that don't depend on the point, for differences between
// points.
#pragma once

#include "derivatives/difference_stencil.h"
#include "derivatives/estimator.h"
#include "transport/path_tracer.h"
#include "transport/plan.h"

namespace fogbank::derivatives {

/// Environments, reflected light and light from the medium, as far as the plan has them on. Directions,
/// distances (by their quantiles) and the random numbers of every path are functions of (seed, repeat,
/// direction) alone.
class CorrelatedLight {
 public:
  /// `directions` is rounded to 16 m^2: m x m strata in each of 16 batches. `around` and `repeat` select the
  /// random numbers.
  CorrelatedLight(const transport::World& world, const transport::Plan& plan,
                  const transport::PathTracer& paths, int32_t directions, const Vec3f& around, uint64_t seed,
                  uint32_t repeat);

  /// One mean over its directions for each batch.
  ValueBatches at(const Vec3d& x, int32_t medium, RayCounters& counters) const;

 private:
  Spectrum from_direction(const Vec3f& x, int32_t medium, const Vec3f& direction, float u_distance,
                          RandomStream& random, RayCounters& counters) const;
  Spectrum from_environments(const Vec3f& x, int32_t medium, const Vec2f& u, RayCounters& counters) const;

  const transport::World& world_;
  const transport::Plan& plan_;
  const transport::PathTracer& paths_;
  int32_t side_;  ///< of the whole grid of directions, a multiple of 4
  Vec3f around_;
  uint64_t seed_;
  uint32_t repeat_;
};

}  // namespace fogbank::derivatives
