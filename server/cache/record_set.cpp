#include "cache/record_set.h"

#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>
#include <tbb/parallel_sort.h>

#include <algorithm>
#include <bit>
#include <compare>
#include <limits>

#include "cache/hilbert.h"
#include "cache/packed_normal.h"

namespace fogbank::cache {
namespace {

/// What orders records, but for their contents.
struct Key {
  uint64_t curve = 0;
  Vec3f position{0};
  uint32_t normal = 0;
  uint64_t id = 0;
};

Key key_of(const HilbertCurve& curve, const Record& record) {
  const bool on_surface = record.component.quantity == Quantity::irradiance;
  return {curve.index(record.position), record.position, on_surface ? pack_particular(record) : 0, record.id};
}

/// Records of a place are neighbours.
std::strong_ordering compare_places(const Key& a, const Key& b) {
  if (a.curve != b.curve) return a.curve <=> b.curve;
  for (int axis = 0; axis < 3; ++axis)
    if (a.position[axis] != b.position[axis])
      return a.position[axis] < b.position[axis] ? std::strong_ordering::less : std::strong_ordering::greater;
  return a.normal <=> b.normal;
}

std::strong_ordering compare(const Key& a, const Key& b) {
  const std::strong_ordering places = compare_places(a, b);
  return places != 0 ? places : a.id <=> b.id;
}

/// Bytes as numbers: any total order will do. There are no bytes of padding.
std::strong_ordering compare_contents(const Record& a, const Record& b) {
  using Bytes = std::array<uint8_t, 224>;
  return std::bit_cast<Bytes>(a) <=> std::bit_cast<Bytes>(b);
}

/// Where a record belongs in the set's order. The curve decides nearly always, and saves touching the record.
struct Rank {
  uint64_t curve;
  uint32_t component;  ///< number among the set's components
  uint32_t index;      ///< into the records
};

class Order {
 public:
  Order(const std::vector<Record>& records, const HilbertCurve& curve) : records_(records), curve_(curve) {}

  bool operator()(const Rank& a, const Rank& b) const {
    if (a.component != b.component) return a.component < b.component;
    if (a.curve != b.curve) return a.curve < b.curve;
    const Record& first = records_[a.index];
    const Record& second = records_[b.index];
    const std::strong_ordering keys = compare(key_of(curve_, first), key_of(curve_, second));
    if (keys != 0) return keys < 0;
    const std::strong_ordering contents = compare_contents(first, second);
    return contents != 0 ? contents < 0 : a.index < b.index;
  }

 private:
  const std::vector<Record>& records_;
  const HilbertCurve& curve_;
};

std::vector<Component> components_of(const std::vector<Record>& records) {
  std::vector<Component> result;
  for (const Record& record : records) {
    if (!result.empty() && result.back() == record.component) continue;
    const auto place = std::lower_bound(result.begin(), result.end(), record.component);
    if (place == result.end() || *place != record.component) result.insert(place, record.component);
  }
  return result;
}

std::vector<Rank> ranks(const std::vector<Record>& records, const HilbertCurve& curve) {
  const std::vector<Component> components = components_of(records);
  std::vector<Rank> result(records.size());
  tbb::parallel_for(size_t{0}, records.size(), [&](size_t i) {
    const auto component = std::lower_bound(components.begin(), components.end(), records[i].component);
    result[i] = {curve.index(records[i].position), static_cast<uint32_t>(component - components.begin()),
                 static_cast<uint32_t>(i)};
  });
  tbb::parallel_sort(result.begin(), result.end(), Order(records, curve));
  return result;
}

/// Whether `b`, which comes after `a`, begins another place, or another component even.
enum class Step : uint8_t { same_place, place, component };

Step step(const Record& a, const Record& b) {
  if (a.component != b.component) return Step::component;
  return a.position == b.position && a.normal == b.normal ? Step::same_place : Step::place;
}

}  // namespace

RecordSet::RecordSet(std::vector<Record> records, size_t* conflicts) {
  if (conflicts != nullptr) *conflicts = 0;
  tbb::parallel_for(size_t{0}, records.size(), [&](size_t i) {
    validate(records[i]);
    records[i] = canonical(records[i]);
  });
  float extent = 0;
  for (const Record& record : records) extent = std::max(extent, max_component(glm::abs(record.position)));
  std::vector<Rank> order = ranks(records, HilbertCurve(extent));
  const auto duplicate = [&](const Rank& a, const Rank& b) {
    const Record& first = records[a.index];
    const Record& second = records[b.index];
    if (a.curve != b.curve || first.id != second.id || step(first, second) != Step::same_place) return false;
    if (conflicts != nullptr && compare_contents(first, second) != 0) ++*conflicts;
    return true;
  };
  order.erase(std::unique(order.begin(), order.end(), duplicate), order.end());
  assemble(order.size(), [&](size_t i) { return records[order[i].index]; });
}

void RecordSet::assemble(size_t count, const std::function<Record(size_t)>& get) {
  if (count == 0) return;
  ids_.resize(count);
  shading_.resize(count + 1);
  depth_.resize(count);
  nearest_.resize(count);
  details_.resize(count);
  margins_.resize(count);
  std::vector<Vec3f> positions(count);
  std::vector<uint32_t> particulars(count);
  std::vector<DirectionalShape> shapes(count);
  std::vector<Component> components(count);
  std::vector<Step> steps(count);
  tbb::parallel_for(tbb::blocked_range<size_t>(0, count, 1024), [&](const tbb::blocked_range<size_t>& block) {
    Record previous = block.begin() > 0 ? get(block.begin() - 1) : Record{};
    for (size_t i = block.begin(); i < block.end(); ++i) {
      const Record record = get(i);
      steps[i] = i == 0 ? Step::component : step(previous, record);
      positions[i] = record.position;
      components[i] = record.component;
      particulars[i] = pack_particular(record);
      shapes[i] = record.shape;
      ids_[i] = record.id;
      shading_[i].radiance = record.radiance;
      for (int axis = 0; axis < 3; ++axis)
        for (int channel = 0; channel < 3; ++channel)
          shading_[i].derivatives[static_cast<size_t>(axis)][channel] =
              record.gradient[static_cast<size_t>(channel)][axis];
      depth_[i] = record.depth;
      nearest_[i] = *std::min_element(record.depth.codes.begin(), record.depth.codes.end());
      details_[i] = {record.hessian, record.variance, record.samples};
      margins_[i] = pack_margin(record.visibility_margin);
      previous = record;
    }
  });

  size_t packets = 0;
  size_t particular_count = 0;
  size_t shape_count = 0;
  for (size_t i = 0; i < count; ++i) {
    if (steps[i] == Step::component) {
      ComponentRange range;
      range.component = components[i];
      range.first_record = i;
      range.first_packet = packets;
      range.first_particular = particular_count;
      range.first_shape = shape_count;
      components_.push_back(std::move(range));
    }
    ComponentRange& range = components_.back();
    if (steps[i] != Step::same_place) {
      if (range.place_count++ % packet_size == 0) ++packets;
    }
    ++range.record_count;
    if (has_particular(range.component.quantity)) ++particular_count;
    if (has_shape(range.component.quantity)) ++shape_count;
  }
  components_.shrink_to_fit();
  positions_.resize(packets);
  particulars_.resize(particular_count);
  shapes_.resize(shape_count);
  for (ComponentRange& range : components_) {
    const bool several = range.record_count > range.place_count;
    if (several) range.starts.reserve(size_t{range.place_count} + 1);
    uint32_t place = 0;
    for (size_t i = 0; i < range.record_count; ++i) {
      const size_t record = range.first_record + i;
      extent_ = std::max(extent_, max_component(glm::abs(positions[record])));
      if (has_particular(range.component.quantity))
        particulars_[range.first_particular + i] = particulars[record];
      if (has_shape(range.component.quantity)) shapes_[range.first_shape + i] = shapes[record];
      if (steps[record] == Step::same_place) continue;
      PositionPacket& packet = positions_[range.first_packet + place / packet_size];
      for (int axis = 0; axis < 3; ++axis) packet.at(axis, place % packet_size) = positions[record][axis];
      ++place;
      if (several) range.starts.push_back(static_cast<uint32_t>(i));
    }
    if (several) range.starts.push_back(static_cast<uint32_t>(range.record_count));
  }
}

uint32_t RecordSet::place_of(const ComponentRange& range, size_t index) const {
  const auto number = static_cast<uint32_t>(index - range.first_record);
  if (range.starts.empty()) return number;
  const auto after = std::upper_bound(range.starts.begin(), range.starts.end(), number);
  return static_cast<uint32_t>(after - range.starts.begin() - 1);
}

Vec3f RecordSet::position(const ComponentRange& range, uint32_t place) const {
  const PositionPacket& packet = positions_[range.first_packet + place / packet_size];
  const uint32_t lane = place % packet_size;
  return {packet.at(0, lane), packet.at(1, lane), packet.at(2, lane)};
}

Vec3f RecordSet::normal(const ComponentRange& range, uint32_t place) const {
  return range.component.quantity == Quantity::irradiance
             ? unpack_normal(particulars_[range.first_particular + range.begin(place)])
             : Vec3f(0);
}

Record RecordSet::record(size_t index) const {
  const auto after = std::upper_bound(
      components_.begin(), components_.end(), index,
      [](size_t number, const ComponentRange& range) { return number < range.first_record; });
  return record(*(after - 1), index);
}

Record RecordSet::record(const ComponentRange& range, size_t index) const {
  Record result;
  result.id = ids_[index];
  result.component = range.component;
  result.position = position(range, place_of(range, index));
  result.radiance = shading_[index].radiance;
  for (int axis = 0; axis < 3; ++axis)
    for (int channel = 0; channel < 3; ++channel)
      result.gradient[static_cast<size_t>(channel)][axis] =
          shading_[index].derivatives[static_cast<size_t>(axis)][channel];
  result.hessian = details_[index].hessian;
  if (has_particular(range.component.quantity))
    unpack_particular(particulars_[range.first_particular + index - range.first_record], result);
  if (const DirectionalShape* of_record = shape(range, index)) result.shape = *of_record;
  result.depth = depth_[index];
  result.visibility_margin = unpack_margin(margins_[index]);
  result.samples = details_[index].samples;
  result.variance = details_[index].variance;
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
  result.quantity = range.component.quantity;
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
    result.visibility_margin = std::min(result.visibility_margin, unpack_margin(margins_[i]));
  }
  const Record first = record(range, begin);
  result.position = first.position;
  result.normal = first.normal;
  result.proxy = first.proxy;
  result.radiance = radiance;
  for (size_t channel = 0; channel < 3; ++channel) result.gradient[channel] = gradient[channel];
  for (size_t entry = 0; entry < hessian.entries.size(); ++entry)
    result.hessian.entries[entry] = static_cast<float>(hessian.entries[entry]);
  result.variance = static_cast<float>(variance);
  return result;
}

size_t RecordSet::memory() const {
  const auto bytes_of = [](const auto& column) { return column.capacity() * sizeof(column[0]); };
  size_t bytes = bytes_of(positions_) + bytes_of(ids_) + bytes_of(shading_) + bytes_of(depth_) +
                 bytes_of(nearest_) + bytes_of(details_) + bytes_of(margins_) + bytes_of(particulars_) +
                 bytes_of(shapes_) + bytes_of(components_);
  for (const ComponentRange& range : components_) bytes += bytes_of(range.starts);
  return bytes;
}

RecordSet merge(const RecordSet& a, const RecordSet& b, size_t* conflicts) {
  if (conflicts != nullptr) *conflicts = 0;
  const HilbertCurve curve(std::max(a.extent_, b.extent_));
  RecordSet result;
  if (!(curve == HilbertCurve(a.extent_)) || !(curve == HilbertCurve(b.extent_))) {
    // A larger scene has another curve: orders don't fit.
    std::vector<Record> records(a.size() + b.size());
    tbb::parallel_for(size_t{0}, a.size(), [&](size_t i) { records[i] = a.record(i); });
    tbb::parallel_for(size_t{0}, b.size(), [&](size_t i) { records[a.size() + i] = b.record(i); });
    return RecordSet(std::move(records), conflicts);
  }
  /// A record of either set, with the range that it lies in.
  struct Source {
    uint32_t from_b : 1;
    uint32_t range : 31;
    uint32_t index;
  };
  std::vector<Source> order;
  order.reserve(a.size() + b.size());
  const auto take = [&](const RecordSet& set, size_t range, size_t first, size_t last) {
    for (size_t i = first; i < last; ++i)
      order.push_back({&set == &b, static_cast<uint32_t>(range), static_cast<uint32_t>(i)});
  };
  const auto keys = [&](const RecordSet& set, const ComponentRange& range) {
    std::vector<Key> result_keys(range.record_count);
    tbb::parallel_for(size_t{0}, range.record_count, [&](size_t i) {
      result_keys[i] = key_of(curve, set.record(range, range.first_record + i));
    });
    return result_keys;
  };
  size_t in_a = 0;
  size_t in_b = 0;
  while (in_a < a.components_.size() || in_b < b.components_.size()) {
    const ComponentRange* of_a = in_a < a.components_.size() ? &a.components_[in_a] : nullptr;
    const ComponentRange* of_b = in_b < b.components_.size() ? &b.components_[in_b] : nullptr;
    if (of_b == nullptr || (of_a != nullptr && of_a->component < of_b->component)) {
      take(a, in_a++, of_a->first_record, of_a->first_record + of_a->record_count);
      continue;
    }
    if (of_a == nullptr || of_b->component < of_a->component) {
      take(b, in_b++, of_b->first_record, of_b->first_record + of_b->record_count);
      continue;
    }
    const std::vector<Key> keys_a = keys(a, *of_a);
    const std::vector<Key> keys_b = keys(b, *of_b);
    size_t i = 0;
    size_t j = 0;
    while (i < keys_a.size() && j < keys_b.size()) {
      const std::strong_ordering comparison = compare(keys_a[i], keys_b[j]);
      bool use_a = comparison < 0;
      if (comparison == 0) {
        const std::strong_ordering contents = compare_contents(a.record(*of_a, of_a->first_record + i),
                                                               b.record(*of_b, of_b->first_record + j));
        if (contents != 0 && conflicts != nullptr) ++*conflicts;
        use_a = contents <= 0;
      }
      if (use_a)
        take(a, in_a, of_a->first_record + i, of_a->first_record + i + 1);
      else
        take(b, in_b, of_b->first_record + j, of_b->first_record + j + 1);
      if (comparison <= 0) ++i;
      if (comparison >= 0) ++j;
    }
    take(a, in_a, of_a->first_record + i, of_a->first_record + keys_a.size());
    take(b, in_b, of_b->first_record + j, of_b->first_record + keys_b.size());
    ++in_a;
    ++in_b;
  }
  result.assemble(order.size(), [&](size_t i) {
    const RecordSet& set = order[i].from_b != 0 ? b : a;
    return set.record(set.components_[order[i].range], order[i].index);
  });
  return result;
}

}  // namespace fogbank::cache
