// Who makes records: one class per quantity (record_makers/), one line each in record_maker_registry.cpp.
#pragma once

#include <cstdint>
#include <memory>
#include <vector>

#include "cache/index.h"
#include "cache/record.h"
#include "core/ray_counters.h"
#include "transport/world.h"

namespace fogbank::cache {

/// A place that wants a record.
struct Wish {
  Vec3f position{0};
  Vec3f normal{0};  ///< unit, to the side that is asked for; 0 in a medium
  Component component;
};

struct RecordMakerSettings {
  /// Directions in which a record looks into the medium, rounded as EstimatorSettings::samples is; on
  /// surfaces it looks in more.
  int32_t samples = 256;
  int32_t max_depth = -1;  ///< edges of a whole path, as IntegratorSettings; -1: unbounded
  uint64_t seed = 0;
};

/// Immutable; one instance serves all threads.
class RecordMaker {
 public:
  virtual ~RecordMaker() = default;
  /// The record of `wish`: a pure function of (world, settings, wish, sources), valid as validate() asks.
  /// Generation k > 0 reads the light of medium and surfaces from the records of generation k - 1 in
  /// `sources`, and traces paths where none reaches. `sources` may be null. Throws Interrupted soon after
  /// `counters.stop` was set.
  virtual Record make(const Wish& wish, const Epoch* sources, RayCounters& counters) const = 0;
  /// Places whose light `make` would look up in `sources`, a sample of about `count` of them: what the
  /// generation before must cover. Nothing for generation 0.
  virtual std::vector<Wish> sources_of(const Wish& wish, int32_t count, RayCounters& counters) const = 0;
};

/// Throws Error(invalid_argument, "INVALID_SETTINGS") naming the field.
std::unique_ptr<RecordMaker> make_record_maker(Quantity quantity,
                                               std::shared_ptr<const transport::World> world,
                                               const RecordMakerSettings& settings);

}  // namespace fogbank::cache
