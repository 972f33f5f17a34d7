// The occlusion-unaware rival's records, after Jarosz, Donner, Zwicker and Jensen 2008, "Radiance Caching for
// Participating Media" (method.md section 9): gradients with visibility held constant, no Hessian, and the
// length of change that the first-order radius follows from.
#pragma once

#include "cache/record_maker.h"
#include "derivatives/unaware.h"

namespace fogbank::cache {

class UnawareRecordMaker final : public RecordMaker {
 public:
  /// `quantity`: unaware_rest or unaware_direct. Light straight from emitters gets the same rays in both.
  UnawareRecordMaker(Quantity quantity, std::shared_ptr<const transport::World> world,
                     const RecordMakerSettings& settings);

  Record make(const Wish& wish, RayCounters& counters) const override;
  uint64_t id_of(const Wish& wish) const override;

 private:
  DepthBins look_around(const Vec3f& position, RayCounters& counters) const;

  std::shared_ptr<const transport::World> world_;
  derivatives::EstimatorSettings settings_;
  derivatives::Unaware estimator_;
};

}  // namespace fogbank::cache
