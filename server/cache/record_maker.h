// Who makes records: one class per quantity (record_makers/), one line each in record_maker_registry.cpp.
#pragma once

#include <cstdint>
#include <memory>
#include <vector>

#include "cache/photon_field.h"
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
  /// Of records of generation 1: where the paths that they are made of end. Null for generation 0, whose
  /// paths end by themselves.
  std::shared_ptr<PhotonField> photons = nullptr;
};

/// Scattering events between the camera and the light that a record is made of: one, at its own place.
inline constexpr int32_t record_depth = 1;

/// Immutable; one instance serves all threads.
class RecordMaker {
 public:
  virtual ~RecordMaker() = default;
  /// The record of `wish`: a pure function of (world, settings, wish), valid as validate() asks. Throws
  /// Interrupted soon after `counters.stop` was set.
  virtual Record make(const Wish& wish, RayCounters& counters) const = 0;
  /// Record::id of that record, in no time.
  virtual uint64_t id_of(const Wish& wish) const = 0;
};

/// Throws Error(invalid_argument, "INVALID_SETTINGS") naming the field.
std::unique_ptr<RecordMaker> make_record_maker(Quantity quantity,
                                               std::shared_ptr<const transport::World> world,
                                               const RecordMakerSettings& settings);

}  // namespace fogbank::cache
