// Records that use every number, of several components, some places with several.
#pragma once

#include <cstring>
#include <vector>

#include "cache/record_set.h"
#include "record_clouds.h"

namespace fogbank::cache::test {

inline std::vector<Record> varied_records(size_t count, uint64_t seed) {
  std::vector<Record> records = make_cloud(Layout::sheets, count, 12, seed);
  RandomStream random(seed, 0, 0, 0, 9);
  for (size_t i = 0; i < count; ++i) {
    Record& record = records[i];
    if (i % 4 == 3) record.position = records[i - 1].position;
    constexpr Quantity quantities[] = {Quantity::rest, Quantity::irradiance, Quantity::ratio,
                                       Quantity::directional_rest};
    record.component = {static_cast<int32_t>(i / 4 % 2), static_cast<uint16_t>(i / 8 % 3), 1,
                        quantities[i / 12 % 4]};
    if (record.component.quantity == Quantity::irradiance)
      record.normal = square_to_uniform_sphere(random.next_vec2());
    if (record.component.quantity == Quantity::ratio) record.proxy = random.next_float();
    if (has_shape(record.component.quantity)) {
      HarmonicMoments moments;
      for (Vec3f& colour : moments.colour) colour = Vec3f(random.next_float());
      record.shape = DirectionalShape::from_moments(moments);
    }
    record.radiance = {random.next_float(), random.next_float(), random.next_float()};
    for (Vec3f& gradient : record.gradient)
      gradient = {random.next_float(), random.next_float(), random.next_float()};
    record.depth.insert({1, random.next_float(), 0}, random.next_float());
    record.visibility_margin = 0.1f + random.next_float();
    record.samples = 1 + i % 5;
    record.variance = random.next_float();
    record.id = content_id(record.position, record.component, "varied", seed * count + i);
  }
  return records;
}

inline std::vector<Record> all(const RecordSet& set) {
  std::vector<Record> records;
  for (size_t i = 0; i < set.size(); ++i) records.push_back(set.record(i));
  return records;
}

inline bool same(const std::vector<Record>& a, const std::vector<Record>& b) {
  return a.size() == b.size() &&
         (a.empty() || std::memcmp(a.data(), b.data(), a.size() * sizeof(Record)) == 0);
}

inline bool same(const RecordSet& a, const RecordSet& b) { return same(all(a), all(b)); }

}  // namespace fogbank::cache::test
