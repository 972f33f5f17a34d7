// Occlusion-aware derivatives: the method itself (method.md).
#pragma once

#include <memory>

#include "derivatives/estimator.h"
#include "derivatives/light_gather.h"
#include "derivatives/medium_gather.h"
#include "derivatives/path_source.h"
#include "derivatives/sphere_gather.h"
#include "transport/plan.h"

namespace fogbank::derivatives {

/// The sum of what lights emit (a grid each), what surfaces reflect (the sphere grid) and what the medium
/// scatters (along the sphere grid's rays); each only if the scene's plan asks for it.
class Aware final : public Estimator {
 public:
  Aware(std::shared_ptr<const transport::World> world, const EstimatorSettings& settings);

  /// Light of medium and surfaces is path traced.
  RadianceJet estimate(const Vec3f& x, uint32_t repeat, RayCounters& counters) const override;
  /// The same with light from elsewhere at `x` in `medium`. `samples`, made for plan(), keeps what was seen
  /// around x: no rays where the plan wants no sphere grid.
  RadianceJet estimate_from(const LightSources& sources, const Vec3f& x, int32_t medium, uint32_t repeat,
                            SphereSamples& samples, RayCounters& counters) const;
  const transport::Plan& plan() const { return plan_; }

 private:
  void add_medium(const MediumSource& source, const Vec3f& x, SphereSamples& samples, RandomStream& random,
                  RadianceJet& sum, RayCounters& counters) const;

  std::shared_ptr<const transport::World> world_;
  EstimatorSettings settings_;
  transport::Plan plan_;
  LightGather lights_;
  SphereGather sphere_;
  PathTracedSource paths_;
};

}  // namespace fogbank::derivatives
