// Records of rho = M / Mhat, the share of a light's unoccluded proxy that arrives at a point of a medium
// (ratio-records.md): 1 where all of the light is seen through clear air, 0 in umbrae, and in between only as
// curved as the blockers' outlines make it.
#pragma once

#include <map>
#include <vector>

#include "cache/record_maker.h"
#include "derivatives/estimator.h"
#include "derivatives/light_grid.h"
#include "derivatives/light_proxy.h"

namespace fogbank::cache {

/// Component::light_group names the light, Component::medium the medium; make_proxy() of both must not be
/// nullopt. Values, gradients and Hessians are the light grid's (method.md section 7) over the proxy's.
/// Margins: distance to where a blocker first cuts the light, seen from where all of it is visible, or first
/// shows some of it, seen from where none is (ratio-records.md section 2, outlines bisected). Inside
/// penumbrae the Hessian alone counts.
class RatioRecordMaker final : public RecordMaker {
 public:
  RatioRecordMaker(std::shared_ptr<const transport::World> world, const RecordMakerSettings& settings);

  /// Mhat of a light for points of `medium`, on which records of ratios rest; nullopt where there are none: a
  /// light without a closed form, or more lights than Component::light_group can name.
  static std::optional<derivatives::LightProxy> make_proxy(const transport::World& world,
                                                           const transport::Plan& plan, uint32_t light,
                                                           int32_t medium);
  static transport::PlanRequest plan_request();

  /// Throws Error(invalid_argument, "INVALID_WISH") for a light without a proxy.
  Record make(const Wish& wish, RayCounters& counters) const override;
  uint64_t id_of(const Wish& wish) const override;

 private:
  struct ProxiedLight {
    std::unique_ptr<const derivatives::GriddedLight> gridded;
    std::vector<std::optional<derivatives::LightProxy>> proxies;  ///< by medium; the last for vacuum
  };

  std::shared_ptr<const transport::World> world_;
  transport::Plan plan_;
  derivatives::EstimatorSettings settings_;
  double least_distance_;
  std::map<uint32_t, ProxiedLight> lights_;
};

}  // namespace fogbank::cache
