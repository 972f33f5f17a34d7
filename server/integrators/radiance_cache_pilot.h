// A few records at places that follow from the scene alone. They tell how bright its fog is and how fast that
// changes, which the error metric needs to know before a camera is asked.
#pragma once

#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "cache/metric.h"
#include "cache/record_bytes.h"
#include "cache/record_maker.h"
#include "integrators/medium_records.h"
#include "transport/world.h"

namespace fogbank::integrators {

/// Error metric at a target, and how large its extents are.
struct PilotedMetric {
  double threshold = 0;           ///< MetricSettings::threshold
  double first_order_change = 0;  ///< MetricSettings::first_order_change
  double radiance_floor = 0;      ///< MetricSettings::radiance_floor
  float typical_radius = 0;       ///< > 0
};

class CachePilot {
 public:
  /// Of all media of the world that hold records.
  CachePilot(std::shared_ptr<const transport::World> world, const CacheTechnique& technique);

  /// Places, tasks of `make`.
  uint32_t count() const { return static_cast<uint32_t>(records_.size()); }
  /// Takes the records that are there already: those of the fewest samples, which `make` would make again.
  void recall(const cache::RecordSet& set);
  /// Record of a place, unless it was recalled; nothing where the medium wasn't found. Needs
  /// scene::prepare_render_thread. Any thread.
  void make(uint32_t number, const cache::RecordMaker& maker, RayCounters& counters);
  /// In place of `make`, with the record that was made elsewhere.
  void set(uint32_t number, const std::optional<cache::Record>& record) { records_[number] = record; }
  /// What the record of a place describes.
  const cache::Component& component(uint32_t number) const;
  /// The record of a place, or that it has none, as bytes, and back again. Throws Error(invalid_argument,
  /// "POISONED_RESULT").
  void append_to(std::string& bytes, uint32_t number) const { cache::append_record(bytes, records_[number]); }
  std::optional<cache::Record> take_record(cache::ByteReader& bytes, uint32_t number) const;
  std::vector<cache::Record> records() const;
  /// Metric that bounds the relative error at the border of typical extents by `border_error`. Extents are at
  /// most `maximum_radius`.
  PilotedMetric metric(double border_error, double maximum_radius) const;

 private:
  std::optional<Vec3f> place(uint32_t number) const;

  std::shared_ptr<const transport::World> world_;
  std::vector<cache::Component> components_;  ///< one a medium
  std::vector<std::optional<cache::Record>> records_;
};

}  // namespace fogbank::integrators
