// Records of the light that doesn't come straight from an emitter, at points of a medium.
#pragma once

#include "cache/record_maker.h"
#include "derivatives/aware.h"

namespace fogbank::cache {

/// Quantities `rest` and `directional_rest`. Light of medium and surfaces is path traced. Where a medium
/// scatters anisotropically, the derivatives of what it sends are those of a medium that sends its mean
/// radiance: light of another phase function has gradients of about the same size.
class RestRecordMaker final : public RecordMaker {
 public:
  RestRecordMaker(std::shared_ptr<const transport::World> world, const RecordMakerSettings& settings);

  Record make(const Wish& wish, RayCounters& counters) const override;
  uint64_t id_of(const Wish& wish) const override;

 private:
  std::shared_ptr<const transport::World> world_;
  RecordMakerSettings settings_;
  derivatives::Aware surfaces_;  ///< light that surfaces send
  derivatives::Aware medium_;    ///< light that the medium sends
  std::shared_ptr<const transport::PathTracer> kernel_;
};

}  // namespace fogbank::cache
