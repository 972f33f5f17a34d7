// A cache's contents: a grow-only set of records.
#pragma once

#include <functional>
#include <span>
#include <vector>

#include "cache/packet.h"
#include "cache/record.h"

namespace fogbank::cache {

/// What a look-up reads of a record: 48 bytes, extrapolation as three multiply-adds of RGB triples.
struct Shading {
  Spectrum radiance{0};
  std::array<Spectrum, 3> derivatives{};  ///< d radiance / d x, d y, d z
};

/// The records of one component. A *place* is a position, on surfaces with a normal; its records are
/// neighbours, in the order of their ids.
struct ComponentRange {
  Component component;
  size_t first_record = 0;  ///< in the set
  size_t record_count = 0;
  size_t first_packet = 0;      ///< positions of places, 8 a packet, the last one padded
  size_t first_particular = 0;  ///< of the first record, where has_particular()
  size_t first_shape = 0;       ///< of the first record, where has_shape()
  uint32_t place_count = 0;
  /// Number of the first record of each place and one past the last, relative to first_record; empty where
  /// each place has one record, which is what fills make first.
  std::vector<uint32_t> starts;

  uint32_t packet_count() const { return (place_count + packet_size - 1) / packet_size; }
  uint32_t begin(uint32_t place) const { return starts.empty() ? place : starts[place]; }
  uint32_t end(uint32_t place) const { return starts.empty() ? place + 1 : starts[place + 1]; }
};

/// What the records of a place say together: means weighted by samples (records with different ids are
/// independent, M, gradient and Hessian are linear), the most cautious margin.
struct Place {
  Quantity quantity = Quantity::rest;
  Vec3f position{0};
  Spectrum radiance{0};
  std::array<Vec3f, 3> gradient{};  ///< of each channel
  Symmetric3f hessian;
  Vec3f normal{0};
  float proxy = 0;
  float visibility_margin = 0;
  float variance = 0;
};

/// Immutable. Records are canonical() and lie along a Hilbert curve, component by component: an order that is
/// a function of the set alone and keeps neighbours in space near each other in memory. 167 bytes a record,
/// 171 where has_particular(), 199 where has_shape().
class RecordSet {
 public:
  RecordSet() = default;
  /// The set of `records`, in any order; costs less where they come in a set's order. Of records with the
  /// same id and the same place one is kept: that whose bytes are least, so that unions commute even if two
  /// machines disagree about a record; `conflicts`, when given, is told how many differed. Throws
  /// Error(invalid_argument, "INVALID_RECORD") as validate() does.
  explicit RecordSet(std::vector<Record> records, size_t* conflicts = nullptr);

  size_t size() const { return ids_.size(); }
  /// Number `index` in the set's order, 0 <= index < size().
  Record record(size_t index) const;

  /// Ascending by component.
  std::span<const ComponentRange> components() const { return components_; }
  Place place(const ComponentRange& range, uint32_t place) const;
  Vec3f position(const ComponentRange& range, uint32_t place) const;
  /// 0 unless the quantity is irradiance.
  Vec3f normal(const ComponentRange& range, uint32_t place) const;

  std::span<const PositionPacket> positions(const ComponentRange& range) const {
    return std::span(positions_).subspan(range.first_packet, range.packet_count());
  }
  /// By number in the set; one more element than records follows, so that 16 bytes may be read from any
  /// float.
  const Shading* shading() const { return shading_.data(); }
  const DepthBins* depth() const { return depth_.data(); }
  /// Least code of each record's depth bins.
  const uint8_t* nearest() const { return nearest_.data(); }
  uint32_t samples(size_t index) const { return details_[index].samples; }
  /// By number in the set, which lies in `range`; null where the quantity has none.
  const DirectionalShape* shape(const ComponentRange& range, size_t index) const {
    return has_shape(range.component.quantity) ? &shapes_[range.first_shape + index - range.first_record]
                                               : nullptr;
  }

  /// Of all records, in the set's order.
  std::span<const uint64_t> ids() const { return ids_; }
  std::span<const uint64_t> ids(const ComponentRange& range) const {
    return std::span(ids_).subspan(range.first_record, range.record_count);
  }

  /// Bytes of memory held.
  size_t memory() const;

  friend RecordSet merge(const RecordSet& a, const RecordSet& b, size_t* conflicts);

 private:
  struct Details {
    Symmetric3f hessian;
    float variance;
    uint32_t samples;
  };

  /// Fills the set, which is empty, with `count` records that come in order, each once; `get(i)` is called by
  /// several threads.
  void assemble(size_t count, const std::function<Record(size_t)>& get);
  Record record(const ComponentRange& range, size_t index) const;
  uint32_t place_of(const ComponentRange& range, size_t index) const;

  std::vector<ComponentRange> components_;
  std::vector<PositionPacket> positions_;
  std::vector<uint64_t> ids_;
  std::vector<Shading> shading_;
  std::vector<DepthBins> depth_;
  std::vector<uint8_t> nearest_;
  std::vector<Details> details_;
  std::vector<uint16_t> margins_;
  std::vector<uint32_t> particulars_;     ///< of components that have them
  std::vector<DirectionalShape> shapes_;  ///< of components that have them
  float extent_ = 0;                      ///< greatest coordinate, without its sign
};

/// Union: commutative, associative, idempotent. Linear in the sizes, by all threads.
RecordSet merge(const RecordSet& a, const RecordSet& b, size_t* conflicts = nullptr);

}  // namespace fogbank::cache
