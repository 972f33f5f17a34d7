#include "cache/record_set.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <bit>
#include <cstring>

#include "cache/hilbert.h"
#include "core/error.h"
#include "varied_records.h"

namespace fogbank::cache {
namespace {

using test::all;
using test::same;
using test::varied_records;

TEST(RecordSet, KeepsEveryNumber) {
  std::vector<Record> records = varied_records(1000, 1);
  const RecordSet set(records);
  for (Record& record : records) record = canonical(record);
  ASSERT_EQ(set.size(), records.size());
  std::vector<Record> kept = all(set);
  const auto by_id = [](const Record& a, const Record& b) { return a.id < b.id; };
  std::sort(records.begin(), records.end(), by_id);
  std::sort(kept.begin(), kept.end(), by_id);
  EXPECT_TRUE(same(records, kept));
}

TEST(RecordSet, OrderIsAFunctionOfTheSet) {
  std::vector<Record> records = varied_records(500, 2);
  const RecordSet set(records);
  std::reverse(records.begin(), records.end());
  EXPECT_TRUE(same(set, RecordSet(records)));
  std::rotate(records.begin(), records.begin() + 123, records.end());
  records.insert(records.end(), records.begin(), records.begin() + 50);
  EXPECT_TRUE(same(set, RecordSet(records)));
}

TEST(RecordSet, UnionIsCommutativeAssociativeIdempotent) {
  const std::vector<Record> records = varied_records(600, 3);
  const RecordSet a(std::vector<Record>(records.begin(), records.begin() + 300));
  const RecordSet b(std::vector<Record>(records.begin() + 200, records.begin() + 450));
  const RecordSet c(std::vector<Record>(records.begin() + 400, records.end()));
  EXPECT_TRUE(same(merge(a, b), merge(b, a)));
  EXPECT_TRUE(same(merge(merge(a, b), c), merge(a, merge(b, c))));
  EXPECT_TRUE(same(merge(merge(a, b), merge(b, c)), RecordSet(records)));
  EXPECT_TRUE(same(merge(a, a), a));
  EXPECT_TRUE(same(merge(a, RecordSet()), a));
  EXPECT_TRUE(same(merge(RecordSet(), a), a));
}

TEST(RecordSet, UnionOfRandomPartsIsTheWhole) {
  for (uint64_t seed = 0; seed < 20; ++seed) {
    RandomStream random(seed, 1, 0, 0);
    std::vector<Record> records = varied_records(200, 30 + seed);
    // In some rounds a few records lie far out, so that parts are ordered along different curves.
    if (seed % 3 == 0) records[7].position *= 100.0f;
    std::array<std::vector<Record>, 4> parts;
    for (const Record& record : records) {
      const auto part = static_cast<size_t>(random.next_float() * 4);
      parts[part].push_back(record);
      if (random.next_float() < 0.3f) parts[(part + 1) % 4].push_back(record);
    }
    RecordSet forwards;
    RecordSet backwards;
    for (size_t i = 0; i < parts.size(); ++i) {
      size_t conflicts = 1;
      forwards = merge(forwards, RecordSet(parts[i]), &conflicts);
      EXPECT_EQ(conflicts, 0u);
      backwards = merge(RecordSet(parts[3 - i]), backwards);
    }
    EXPECT_TRUE(same(forwards, RecordSet(records)));
    EXPECT_TRUE(same(backwards, forwards));
  }
}

TEST(RecordSet, DisagreementIsSettledTheSameWayInAnyOrder) {
  std::vector<Record> records = varied_records(10, 4);
  Record other = records[5];
  other.radiance.x += 0x1p-20f;
  size_t conflicts = 0;
  std::vector<Record> first = records;
  first.push_back(other);
  std::vector<Record> second = records;
  second.insert(second.begin(), other);
  const RecordSet a(first, &conflicts);
  EXPECT_EQ(conflicts, 1u);
  EXPECT_EQ(a.size(), records.size());
  EXPECT_TRUE(same(a, RecordSet(second)));
  records[5] = other;
  EXPECT_TRUE(same(a, merge(RecordSet(records), a, &conflicts)));
  EXPECT_TRUE(same(a, merge(a, RecordSet(records))));
  const RecordSet agreed(records, &conflicts);
  EXPECT_EQ(conflicts, 0u);
}

TEST(RecordSet, GroupsByComponentAndPlace) {
  const RecordSet set(varied_records(400, 5));
  size_t records = 0;
  for (const ComponentRange& range : set.components()) {
    EXPECT_EQ(range.first_record, records);
    records += range.record_count;
    EXPECT_EQ(range.end(range.place_count - 1), range.record_count);
    for (uint32_t place = 0; place < range.place_count; ++place)
      for (uint32_t i = range.begin(place); i < range.end(place); ++i) {
        EXPECT_EQ(set.record(range.first_record + i).position, set.place(range, place).position);
        EXPECT_EQ(set.record(range.first_record + i).component, range.component);
      }
  }
  EXPECT_EQ(records, set.size());
}

TEST(RecordSet, SidesOfASurfaceAreDifferentPlaces) {
  Record up;
  up.component.quantity = Quantity::irradiance;
  up.normal = {0, 0, 1};
  Record down = up;
  down.normal = {0, 0, -1};
  const RecordSet set({up, down});
  ASSERT_EQ(set.components()[0].place_count, 2u);
  EXPECT_NE(set.normal(set.components()[0], 0), set.normal(set.components()[0], 1));
}

TEST(RecordSet, CanonicalIsIdempotent) {
  for (Record record : varied_records(200, 6)) {
    record.position.x = -0.0f;
    record.position.y = 1e-40f;
    const Record once = canonical(record);
    const Record twice = canonical(once);
    using Bytes = std::array<uint8_t, sizeof(Record)>;
    EXPECT_EQ(std::bit_cast<Bytes>(once), std::bit_cast<Bytes>(twice));
    EXPECT_LE(once.visibility_margin, record.visibility_margin);
    EXPECT_GE(once.visibility_margin, record.visibility_margin * (1 - 0x1p-7f));
    EXPECT_EQ(once.position.y, 0);
  }
}

TEST(RecordSet, PlaceIsTheMeanBySamples) {
  Record a;
  a.id = 1;
  a.position = {1, 2, 3};
  a.radiance = {1, 2, 3};
  a.gradient[1] = {1, 0, 0};
  a.hessian(0, 1) = 8;
  a.samples = 300;
  a.variance = 1;
  a.visibility_margin = 2;
  Record b = a;
  b.id = 2;
  b.radiance = {5, 2, -0.0f};
  b.gradient[1] = {5, 4, 0};
  b.hessian(0, 1) = 0;
  b.samples = 100;
  b.variance = 16;
  b.visibility_margin = 3;
  const RecordSet set({b, a});
  ASSERT_EQ(set.components().size(), 1u);
  ASSERT_EQ(set.components()[0].place_count, 1u);
  const Place place = set.place(set.components()[0], 0);
  EXPECT_EQ(place.radiance, Spectrum(2, 2, 2.25f));
  EXPECT_EQ(place.gradient[1], Vec3f(2, 1, 0));
  EXPECT_EQ(place.hessian(0, 1), 6);
  EXPECT_EQ(place.visibility_margin, 2);
  EXPECT_FLOAT_EQ(place.variance, 0.75f * 0.75f * 1 + 0.25f * 0.25f * 16);
}

TEST(RecordSet, RefusesBadRecords) {
  std::vector<Record> records(3);
  records[1].radiance.x = infinity;
  EXPECT_THROW(RecordSet{records}, Error);
}

TEST(RecordSet, Empty) {
  const RecordSet set(std::vector<Record>{});
  EXPECT_EQ(set.size(), 0u);
  EXPECT_TRUE(set.components().empty());
}

TEST(HilbertCurve, NeighboursOnTheCurveAreNeighboursInSpace) {
  // The defining property: all 8^3 cells of a cube of 8 cells are visited, each a step from the one before.
  const HilbertCurve curve(0.75f);  // cells of 2^-20
  std::vector<std::pair<uint64_t, Vec3f>> cells;
  for (int x = 0; x < 8; ++x)
    for (int y = 0; y < 8; ++y)
      for (int z = 0; z < 8; ++z) {
        const Vec3f centre = (Vec3f(x, y, z) + 0.5f) * 0x1p-20f;
        cells.emplace_back(curve.index(centre), centre);
      }
  std::sort(cells.begin(), cells.end(), [](const auto& a, const auto& b) { return a.first < b.first; });
  for (size_t i = 1; i < cells.size(); ++i) {
    EXPECT_EQ(cells[i].first, cells[i - 1].first + 1);
    EXPECT_EQ(glm::distance(cells[i].second, cells[i - 1].second), 0x1p-20f);
  }
}

TEST(HilbertCurve, AnyExtent) {
  for (const float extent : {0.0f, 1e-38f, 1.0f, 3e38f}) {
    const HilbertCurve curve(extent);
    EXPECT_LT(curve.index(Vec3f(extent)), uint64_t{1} << 63);
    EXPECT_LT(curve.index(Vec3f(-extent)), uint64_t{1} << 63);
    EXPECT_EQ(extent > 0, curve.index(Vec3f(extent)) != curve.index(Vec3f(-extent)));
  }
}

}  // namespace
}  // namespace fogbank::cache
