// Records of the light that doesn't come straight from an emitter, at points of a medium.
#pragma once

#include "cache/record_maker.h"
#include "derivatives/aware.h"

namespace fogbank::cache {

/// Generation 0: the light of medium and surfaces is path traced. Generation k: it is CachedLight of
/// generation k - 1, so that a record costs no paths where those cover its surroundings.
class RestRecordMaker final : public RecordMaker {
 public:
  RestRecordMaker(std::shared_ptr<const transport::World> world, const RecordMakerSettings& settings);

  Record make(const Wish& wish, RayCounters& counters) const override;

 private:
  uint64_t id_of(const Wish& wish) const;

  std::shared_ptr<const transport::World> world_;
  RecordMakerSettings settings_;
  derivatives::Aware surfaces_;  ///< light that surfaces send
  derivatives::Aware medium_;    ///< light that the medium sends
  std::shared_ptr<const transport::PathTracer> kernel_;
};

}  // namespace fogbank::cache
