// Finite differences: the reference on any scene. Slow, and as right as the light it differentiates.
#pragma once

#include <memory>

#include "derivatives/estimator.h"
#include "transport/path_tracer.h"
#include "transport/plan.h"

namespace fogbank::derivatives {

/// Direct light of emitters with a surface is integrated with exact visibility (exact_light_visibility.h)
/// and of delta lights in closed form, both free of noise. The rest (images around the scene, reflected
/// light, light from the medium) is sampled with the same random numbers at all points of the stencil, 64
/// times as many samples as the settings say; its noise shows in the spread of the repeats, which also turn
/// the stencil. A step reaches no farther than a share of the distance to the nearest surface; closer than
/// that to a silhouette's edge or a kink halving finds a smaller one.
class FiniteDifference final : public Estimator {
 public:
  FiniteDifference(std::shared_ptr<const transport::World> world, const EstimatorSettings& settings);

  RadianceJet estimate(const Vec3f& x, uint32_t repeat, RayCounters& counters) const override;

 private:
  std::shared_ptr<const transport::World> world_;
  EstimatorSettings settings_;
  transport::Plan plan_;
  transport::PathTracer paths_;
};

}  // namespace fogbank::derivatives
