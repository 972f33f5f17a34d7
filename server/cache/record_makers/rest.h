// Records of the light that doesn't come straight from an emitter, at points of a medium.
#pragma once

#include "cache/record_maker.h"
#include "derivatives/estimator.h"

namespace fogbank::cache {

class RestRecordMaker final : public RecordMaker {
 public:
  RestRecordMaker(std::shared_ptr<const transport::World> world, const RecordMakerSettings& settings);

  Record make(const Wish& wish, const Epoch* sources, RayCounters& counters) const override;
  std::vector<Wish> sources_of(const Wish& wish, int32_t count, RayCounters& counters) const override;

 private:
  std::shared_ptr<const transport::World> world_;
  derivatives::EstimatorSettings settings_;
  std::unique_ptr<const derivatives::Estimator> estimator_;
};

}  // namespace fogbank::cache
