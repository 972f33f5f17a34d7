#include "cache/index.h"

#include <algorithm>
#include <cstring>

#include "cache/extents.h"

namespace fogbank::cache {
namespace {

using Float4 = float __attribute__((vector_size(16)));

constexpr float greatest_value = 1e30f;

Float4 load(const float* first) {
  Float4 result;
  std::memcpy(&result, first, sizeof(result));
  return result;
}

Float8 load8(const float* first) {
  Float8 result;
  std::memcpy(&result, first, sizeof(result));
  return result;
}

/// M + g . dx; the fourth element is another number of the record's neighbourhood and means nothing.
Float4 extrapolate(const Shading& shading, float x, float y, float z) {
  const auto* numbers = reinterpret_cast<const float*>(&shading);
  return load(numbers) + load(numbers + 3) * x + load(numbers + 6) * y + load(numbers + 9) * z;
}

Float4 clamp(Float4 value) {
  const Float4 zero{};
  const Float4 positive = value > zero ? value : zero;
  return positive < greatest_value ? positive : zero + greatest_value;
}

/// Per lane: weight of a hit, its distance as DepthBins::encode has it (but not clamped) and the depth bin of
/// its direction (as DepthBins::bin).
struct Lanes {
  Float8 weight;
  Int8 code;
  Int8 bin;
};

Float8 square_root(Float8 values) {
  Float8 result;
  for (uint32_t i = 0; i < packet_size; ++i) result[i] = std::sqrt(values[i]);
  return result;
}

Float8 absolute(Float8 values) { return values < 0.0f ? -values : values; }

Lanes weigh(const Hits& hits, uint32_t first) {
  const Float8 x = load8(hits.x.data() + first);
  const Float8 y = load8(hits.y.data() + first);
  const Float8 z = load8(hits.z.data() + first);
  Lanes lanes;
  const Float8 d = 1.0f - square_root(load8(hits.squared_distance.data() + first));
  lanes.weight = d * d * (3.0f - 2.0f * d);
  lanes.code = (std::bit_cast<Int8>(square_root(x * x + y * y + z * z)) >> DepthBins::mantissa_shift) -
               DepthBins::code_base;
  const Float8 scale = 1.0f / (absolute(x) + absolute(y) + absolute(z));
  const Float8 u = x * scale;
  const Float8 v = y * scale;
  const Float8 folded_u = u < 0.0f ? absolute(v) - 1.0f : 1.0f - absolute(v);
  const Float8 folded_v = v < 0.0f ? absolute(u) - 1.0f : 1.0f - absolute(u);
  constexpr float half = 0.5f * DepthBins::resolution;
  const Float8 column = ((z < 0.0f ? folded_u : u) + 1.0f) * half;
  const Float8 row = ((z < 0.0f ? folded_v : v) + 1.0f) * half;
  constexpr float last = DepthBins::resolution - 1;
  const auto cell = [](Float8 coordinate) {
    // In range for the centre itself, too, where it is NaN.
    const Float8 clamped =
        coordinate > 0.0f ? (coordinate < last ? coordinate : broadcast(last)) : broadcast(0);
    return __builtin_convertvector(clamped, Int8);
  };
  lanes.bin = cell(row) * static_cast<int32_t>(DepthBins::resolution) + cell(column);
  return lanes;
}

}  // namespace

Index::Index(std::shared_ptr<const RecordSet> set, const ComponentRange& range,
             const MetricSettings& settings)
    : set_(std::move(set)), range_(&range), depth_guard_(settings.guards.depth) {
  const std::vector<Ellipsoid> ellipsoids = guarded_ellipsoids(*set_, range, settings);
  tree_ = EllipsoidTree(set_->positions(range), range.place_count, [&](uint32_t i) { return ellipsoids[i]; });
}

Interpolation Index::look_up(const Vec3f& point) const {
  Interpolation result;
  tree_.search(set_->positions(*range_), point, [&](const Hits& hits) { add(hits, result); });
  if (result.weight > 0) result.radiance /= result.weight;
  return result;
}

void Index::add(const Hits& hits, Interpolation& result) const {
  const Shading* shading = set_->shading() + range_->first_record;
  const DepthBins* depth = set_->depth() + range_->first_record;
  Float4 sum{result.radiance.x, result.radiance.y, result.radiance.z, 0};
  float weight_sum = result.weight;
  uint32_t records = 0;
  for (uint32_t first = 0; first < hits.count; first += packet_size) {
    const Lanes lanes = weigh(hits, first);
    const uint32_t count = std::min(packet_size, hits.count - first);
    for (uint32_t lane = 0; lane < count; ++lane) {
      const uint32_t place = hits.places[first + lane];
      const float x = hits.x[first + lane];
      const float y = hits.y[first + lane];
      const float z = hits.z[first + lane];
      const auto bin = static_cast<size_t>(lanes.bin[lane]);
      const int32_t code = lanes.code[lane];
      bool reaches = true;
      Float4 value{};
      if (range_->starts.empty()) {
        value = extrapolate(shading[place], x, y, z);
        reaches = code < int32_t{depth[place].codes[bin]};
      } else {
        float total = 0;
        for (uint32_t record = range_->begin(place); record < range_->end(place); ++record) {
          const auto samples = static_cast<float>(set_->samples(range_->first_record + record));
          total += samples;
          value += samples * extrapolate(shading[record], x, y, z);
          reaches &= code < int32_t{depth[record].codes[bin]};
        }
        value /= total;
      }
      reaches |= !depth_guard_;
      const float weight = reaches ? lanes.weight[lane] : 0.0f;
      sum += weight * clamp(value);
      weight_sum += weight;
      records += reaches ? 1 : 0;
    }
  }
  result.radiance = {sum[0], sum[1], sum[2]};
  result.weight = weight_sum;
  result.records += records;
  result.rejected += hits.count - records;
}

Epoch::Epoch(std::shared_ptr<const RecordSet> set, const MetricSettings& settings) : set_(std::move(set)) {
  validate(settings);
  indices_.reserve(set_->components().size());
  for (const ComponentRange& range : set_->components()) indices_.emplace_back(set_, range, settings);
}

const Index* Epoch::find(const Component& component) const {
  const auto found = std::lower_bound(
      indices_.begin(), indices_.end(), component,
      [](const Index& index, const Component& wanted) { return index.component() < wanted; });
  return found != indices_.end() && found->component() == component ? &*found : nullptr;
}

size_t Epoch::memory() const {
  size_t bytes = set_->memory();
  for (const Index& index : indices_) bytes += index.memory() + sizeof(Index);
  return bytes;
}

}  // namespace fogbank::cache
