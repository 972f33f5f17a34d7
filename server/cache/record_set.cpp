#include "cache/record_set.h"

#include <tbb/parallel_for.h>
#include <tbb/parallel_sort.h>

#include <algorithm>
#include <bit>
#include <compare>

#include "cache/hilbert.h"

namespace fogbank::cache {
namespace {

/// Where a record belongs in the set's order.
struct Rank {
  uint64_t curve;
  uint32_t component;  ///< number among the set's components
  uint32_t index;      ///< into the records
};

bool same_place(const Record& a, const Record& b) {
  return a.component == b.component && a.position == b.position;
}

/// Bytes as numbers: any total order will do. There are no bytes of padding.
auto compare_contents(const Record& a, const Record& b) {
  using Bytes = std::array<uint8_t, 192>;
  return std::bit_cast<Bytes>(a) <=> std::bit_cast<Bytes>(b);
}

class Order {
 public:
  explicit Order(const std::vector<Record>& records) : records_(records) {}

  bool operator()(const Rank& a, const Rank& b) const {
    if (a.component != b.component) return a.component < b.component;
    if (a.curve != b.curve) return a.curve < b.curve;
    const Record& first = records_[a.index];
    const Record& second = records_[b.index];
    for (int axis = 0; axis < 3; ++axis)
      if (first.position[axis] != second.position[axis]) return first.position[axis] < second.position[axis];
    if (first.id != second.id) return first.id < second.id;
    const auto contents = compare_contents(first, second);
    return contents != 0 ? contents < 0 : a.index < b.index;
  }

 private:
  const std::vector<Record>& records_;
};

std::vector<Component> components_of(const std::vector<Record>& records) {
  std::vector<Component> result;
  for (const Record& record : records) {
    const auto place = std::lower_bound(result.begin(), result.end(), record.component);
    if (place == result.end() || *place != record.component) result.insert(place, record.component);
  }
  return result;
}

std::vector<Rank> ranks(const std::vector<Record>& records) {
  float extent = 0;
  for (const Record& record : records) extent = std::max(extent, max_component(glm::abs(record.position)));
  const HilbertCurve curve(extent);
  const std::vector<Component> components = components_of(records);
  std::vector<Rank> result(records.size());
  tbb::parallel_for(size_t{0}, records.size(), [&](size_t i) {
    const auto component = std::lower_bound(components.begin(), components.end(), records[i].component);
    result[i] = {curve.index(records[i].position), static_cast<uint32_t>(component - components.begin()),
                 static_cast<uint32_t>(i)};
  });
  tbb::parallel_sort(result.begin(), result.end(), Order(records));
  return result;
}

}  // namespace

RecordSet::RecordSet(std::vector<Record> records, size_t* conflicts) {
  for (Record& record : records) {
    validate(record);
    record.position += 0.0f;  // -0 is 0: the same place
  }
  if (conflicts != nullptr) *conflicts = 0;
  if (records.empty()) return;
  const std::vector<Rank> order = ranks(records);

  // Sizes first, for memory to be no larger than what is kept.
  size_t kept = 0;
  size_t packets = 0;
  uint32_t places = 0;
  const Record* previous = nullptr;
  std::vector<bool> dropped(order.size());
  for (size_t i = 0; i < order.size(); ++i) {
    const Record& record = records[order[i].index];
    const bool same = previous != nullptr && same_place(*previous, record);
    if (same && previous->id == record.id) {
      dropped[i] = true;
      if (conflicts != nullptr && compare_contents(*previous, record) != 0) ++*conflicts;
      continue;
    }
    if (previous == nullptr || previous->component != record.component) {
      packets += (places + packet_size - 1) / packet_size;
      places = 0;
    }
    if (!same) ++places;
    ++kept;
    previous = &record;
  }
  packets += (places + packet_size - 1) / packet_size;
  positions_.reserve(packets);
  ids_.reserve(kept);
  shading_.reserve(kept + 1);
  depth_.reserve(kept);
  nearest_.reserve(kept);
  details_.reserve(kept);

  for (size_t i = 0; i < order.size(); ++i)
    if (!dropped[i]) append(records[order[i].index]);
  shading_.emplace_back();
  for (ComponentRange& range : components_) {
    if (range.record_count == range.place_count)
      range.starts = {};
    else
      range.starts.push_back(static_cast<uint32_t>(range.record_count));
    range.starts.shrink_to_fit();
  }
}

void RecordSet::append(const Record& record) {
  if (components_.empty() || components_.back().component != record.component) {
    ComponentRange range;
    range.component = record.component;
    range.first_record = ids_.size();
    range.first_packet = positions_.size();
    components_.push_back(std::move(range));
  }
  ComponentRange& range = components_.back();
  const auto position_of = [&](uint32_t place) {
    const PositionPacket& packet = positions_[range.first_packet + place / packet_size];
    const uint32_t lane = place % packet_size;
    return Vec3f(packet.at(0, lane), packet.at(1, lane), packet.at(2, lane));
  };
  if (range.place_count == 0 || position_of(range.place_count - 1) != record.position) {
    const uint32_t lane = range.place_count % packet_size;
    if (lane == 0) positions_.emplace_back();
    for (int axis = 0; axis < 3; ++axis) positions_.back().at(axis, lane) = record.position[axis];
    range.starts.push_back(static_cast<uint32_t>(range.record_count));
    ++range.place_count;
  }
  ++range.record_count;
  ids_.push_back(record.id);
  Shading shading;
  shading.radiance = record.radiance;
  for (int axis = 0; axis < 3; ++axis)
    for (int channel = 0; channel < 3; ++channel)
      shading.derivatives[static_cast<size_t>(axis)][channel] =
          record.gradient[static_cast<size_t>(channel)][axis];
  shading_.push_back(shading);
  depth_.push_back(record.depth);
  nearest_.push_back(*std::min_element(record.depth.codes.begin(), record.depth.codes.end()));
  details_.push_back({record.hessian, record.normal, record.proxy, record.visibility_margin, record.samples,
                      record.variance});
}

Record RecordSet::record(size_t index) const {
  const auto after = std::upper_bound(
      components_.begin(), components_.end(), index,
      [](size_t number, const ComponentRange& range) { return number < range.first_record; });
  const ComponentRange& range = *(after - 1);
  auto place = static_cast<uint32_t>(index - range.first_record);
  if (!range.starts.empty())
    place = static_cast<uint32_t>(std::upper_bound(range.starts.begin(), range.starts.end(), place) -
                                  range.starts.begin() - 1);
  const PositionPacket& packet = positions_[range.first_packet + place / packet_size];
  Record result;
  result.id = ids_[index];
  result.component = range.component;
  result.radiance = shading_[index].radiance;
  for (int axis = 0; axis < 3; ++axis) {
    result.position[axis] = packet.at(axis, place % packet_size);
    for (int channel = 0; channel < 3; ++channel)
      result.gradient[static_cast<size_t>(channel)][axis] =
          shading_[index].derivatives[static_cast<size_t>(axis)][channel];
  }
  const Details& details = details_[index];
  result.hessian = details.hessian;
  result.normal = details.normal;
  result.proxy = details.proxy;
  result.depth = depth_[index];
  result.visibility_margin = details.visibility_margin;
  result.samples = details.samples;
  result.variance = details.variance;
  return result;
}

Place RecordSet::place(const ComponentRange& range, uint32_t place) const {
  const size_t begin = range.first_record + range.begin(place);
  const size_t end = range.first_record + range.end(place);
  double total = 0;
  for (size_t i = begin; i < end; ++i) total += details_[i].samples;
  glm::dvec3 radiance(0);
  std::array<glm::dvec3, 3> gradient{};
  Symmetric3d hessian;
  double variance = 0;
  Place result;
  result.visibility_margin = std::numeric_limits<float>::infinity();
  for (size_t i = begin; i < end; ++i) {
    const double share = details_[i].samples / total;
    radiance += share * glm::dvec3(shading_[i].radiance);
    for (size_t channel = 0; channel < 3; ++channel)
      for (size_t axis = 0; axis < 3; ++axis)
        gradient[channel][static_cast<int>(axis)] +=
            share * static_cast<double>(shading_[i].derivatives[axis][static_cast<int>(channel)]);
    for (size_t entry = 0; entry < hessian.entries.size(); ++entry)
      hessian.entries[entry] += share * static_cast<double>(details_[i].hessian.entries[entry]);
    variance += share * share * static_cast<double>(details_[i].variance);
    result.visibility_margin = std::min(result.visibility_margin, details_[i].visibility_margin);
  }
  const PositionPacket& packet = positions_[range.first_packet + place / packet_size];
  const uint32_t lane = place % packet_size;
  result.position = {packet.at(0, lane), packet.at(1, lane), packet.at(2, lane)};
  result.normal = details_[begin].normal;
  result.proxy = details_[begin].proxy;
  result.radiance = radiance;
  for (size_t channel = 0; channel < 3; ++channel) result.gradient[channel] = gradient[channel];
  for (size_t entry = 0; entry < hessian.entries.size(); ++entry)
    result.hessian.entries[entry] = static_cast<float>(hessian.entries[entry]);
  result.variance = static_cast<float>(variance);
  return result;
}

size_t RecordSet::memory() const {
  size_t bytes = positions_.capacity() * sizeof(PositionPacket) + ids_.capacity() * sizeof(uint64_t) +
                 shading_.capacity() * sizeof(Shading) + depth_.capacity() * sizeof(DepthBins) +
                 nearest_.capacity() + details_.capacity() * sizeof(Details) +
                 components_.capacity() * sizeof(ComponentRange);
  for (const ComponentRange& range : components_) bytes += range.starts.capacity() * sizeof(uint32_t);
  return bytes;
}

RecordSet merge(const RecordSet& a, const RecordSet& b, size_t* conflicts) {
  std::vector<Record> records;
  records.reserve(a.size() + b.size());
  for (size_t i = 0; i < a.size(); ++i) records.push_back(a.record(i));
  for (size_t i = 0; i < b.size(); ++i) records.push_back(b.record(i));
  return RecordSet(std::move(records), conflicts);
}

}  // namespace fogbank::cache
