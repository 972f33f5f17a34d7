// Light that surfaces send to a point because they reflect it, gathered over the whole sphere of directions:
// the part of M_surf (method.md section 1) that no light's own grid counts.
#pragma once

#include <memory>
#include <vector>

#include "derivatives/derivative_variance.h"
#include "derivatives/estimator.h"
#include "derivatives/outlines.h"
#include "derivatives/sphere_rays.h"

namespace fogbank::derivatives {

/// One sample of everything around a point; for one thread, reusable. What marches through the medium goes
/// along the same rays.
struct SphereSamples {
  /// `world` and `plan`, which is for the gather's settings, must outlive it.
  SphereSamples(const transport::World& world, const transport::Plan& plan) : rays(world, plan) {}

  SphereRays rays;
  Outlines outlines;
  std::vector<Spectrum> radiance;  ///< leaving each ray's end towards the point; unbiased, noisy
  /// What arrives along each ray from everything that was gathered, and its luminance: the estimate's value
  /// is their mean.
  std::vector<Vec3d> light;
  std::vector<double> arriving;
  DerivativeVariance medium_variance;  ///< of the medium's light
};

/// Immutable; serves all threads.
class SphereGather {
 public:
  SphereGather(std::shared_ptr<const transport::World> world, const EstimatorSettings& settings);

  /// Traces the rays from `x` in `medium`.
  void trace(const Vec3f& x, int32_t medium, RandomStream& random, SphereSamples& samples,
             RayCounters& counters) const;
  /// Samples radiance at the rays' ends, settings.samples times altogether.
  void sample_radiance(const SurfaceSource& source, RandomStream& random, SphereSamples& samples,
                       RayCounters& counters) const;
  /// Looks for outlines, with at most as many rays as the grid has; of what `sample_radiance` found if it was
  /// called. Nothing to do if no derivatives are asked for.
  void find_outlines(SphereSamples& samples, RayCounters& counters) const;
  /// Mean incoming radiance of those samples. The value is the stratified mean; gradient and Hessian are the
  /// triangulation's, scaled by the ratio of the luminances of the two values (method.md section 6.1). Mean
  /// rule on triangles whose ends lie on surfaces that meet, farthest rule on slanted ones, which outlines
  /// split first (sections 2, 5, 6.2). Finite. Boundaries of media count as planes; behind mirrors the medium
  /// around x counts for the gradient. Throws Interrupted.
  RadianceJet gather(const SphereSamples& samples, const RayCounters& counters = {}) const;

 private:
  std::shared_ptr<const transport::World> world_;
  EstimatorSettings settings_;
};

}  // namespace fogbank::derivatives
