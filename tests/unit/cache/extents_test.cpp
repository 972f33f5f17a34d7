#include "cache/extents.h"

#include <gtest/gtest.h>
#include <tbb/global_control.h>

#include <algorithm>
#include <map>

#include "record_clouds.h"

namespace fogbank::cache {
namespace {

/// Records on a line, 0.1 apart, of the field `radiance` (with its own slopes); flat Hessians: each would
/// reach the maximum radius.
RecordSet line(const std::vector<float>& radiance, float slope = 0, float variance = 0) {
  std::vector<Record> records;
  for (size_t i = 0; i < radiance.size(); ++i) {
    Record record;
    record.position = {0.1f * static_cast<float>(i), 0, 0};
    record.id = content_id(record.position, {}, "line", i);
    record.radiance = Spectrum(radiance[i]);
    record.gradient.fill({slope, 0, 0});
    record.variance = variance;
    records.push_back(record);
  }
  return RecordSet(records);
}

MetricSettings settings() {
  MetricSettings result;
  result.threshold = 1e-9;  // tolerance of verifying: 0.5 % for axes above 1e-3
  result.radiance_floor = 0.1;
  result.maximum_radius = 0.35;
  return result;
}

std::map<float, Ellipsoid> by_x(const RecordSet& set, const MetricSettings& with) {
  const ComponentRange& range = set.components()[0];
  const std::vector<Ellipsoid> ellipsoids = guarded_ellipsoids(set, range, with);
  std::map<float, Ellipsoid> result;
  for (uint32_t i = 0; i < range.place_count; ++i) result[set.place(range, i).position.x] = ellipsoids[i];
  return result;
}

TEST(Verify, LeavesWhatAgrees) {
  for (const auto& [x, ellipsoid] : by_x(line({1, 1.2f, 1.4f, 1.6f, 1.8f}, 2), settings()))
    EXPECT_EQ(ellipsoid.longest(), 0.35f) << x;
}

TEST(Verify, ShrinksWhereANeighbourDisagrees) {
  // Between x = 0.2 and 0.3 the field jumps; records up to 0.35 away are contradicted by far: factor
  // sqrt(q) / 2 = distance / (2 * 0.35), least for the nearest one across.
  MetricSettings with = settings();
  with.guards.neighbour_clamp = false;
  const auto shrunk = by_x(line({1, 1, 1, 5, 5, 5}), with);
  const std::vector<float> distances{0.3f, 0.2f, 0.1f, 0.1f, 0.2f, 0.3f};
  size_t i = 0;
  for (const auto& [x, ellipsoid] : shrunk) EXPECT_NEAR(ellipsoid.longest(), distances[i++] / 2, 1e-6f) << x;
  with.guards.verify = false;
  for (const auto& [x, ellipsoid] : by_x(line({1, 1, 1, 5, 5, 5}), with))
    EXPECT_EQ(ellipsoid.longest(), 0.35f) << x;
}

TEST(Verify, MildContradictionsShrinkLess) {
  // Error 0.02 of 1.02 against 0.5 %: sqrt(0.0051 / 0.02) is 0.505.
  MetricSettings with = settings();
  with.guards.neighbour_clamp = false;
  const auto shrunk = by_x(line({1, 1.02f}), with);
  EXPECT_NEAR(shrunk.begin()->second.longest(), 0.1f * std::sqrt(0.0051f / 0.02f), 1e-5f);
}

TEST(Verify, NoiseIsNoContradiction) {
  const auto kept = by_x(line({1, 1.02f}, 0, 1e-4f), settings());  // 2 sqrt(2e-4) = 0.028
  for (const auto& [x, ellipsoid] : kept) EXPECT_EQ(ellipsoid.longest(), 0.35f);
}

TEST(Verify, WhatIsBehindAWallIsNoWitness) {
  std::vector<Record> records;
  const RecordSet open = line({1, 5});
  for (size_t i = 0; i < 2; ++i) {
    records.push_back(open.record(i));
    for (uint8_t& code : records.back().depth.codes) code = DepthBins::encode(0.05f);
  }
  for (const auto& [x, ellipsoid] : by_x(RecordSet(records), settings()))
    EXPECT_EQ(ellipsoid.longest(), 0.35f);
  MetricSettings without = settings();
  without.guards.depth = false;
  for (const auto& [x, ellipsoid] : by_x(RecordSet(records), without)) EXPECT_LT(ellipsoid.longest(), 0.06f);
}

TEST(NeighbourClampOfExtents, BoundsByTheLongestAxes) {
  std::vector<Record> records;
  const RecordSet flat = line({1, 1});
  for (size_t i = 0; i < 2; ++i) records.push_back(flat.record(i));
  records[0].visibility_margin = 0x1p-7f;
  const auto clamped = by_x(RecordSet(records), settings());
  std::vector<float> longest;
  for (const auto& [x, ellipsoid] : clamped) longest.push_back(ellipsoid.longest());
  std::sort(longest.begin(), longest.end());
  EXPECT_FLOAT_EQ(longest[0], 0x1p-7f);
  EXPECT_FLOAT_EQ(longest[1], 0.1f + 0x1p-7f);
}

TEST(MinimumRadiusOfExtents, BeatsEveryGuard) {
  MetricSettings with = settings();
  with.minimum_radius = 0.2;
  for (const auto& [x, ellipsoid] : by_x(line({1, 1, 1, 5, 5, 5}), with))
    EXPECT_GE(ellipsoid.shortest(), 0.2f) << x;
}

TEST(MinimumRadiusOfExtents, LeavesTheGradientTheChangeThatItHad) {
  // Extrapolation of 1 by a slope of 10 is positive up to 0.1.
  const RecordSet steep = line({1}, 10);
  const ComponentRange& range = steep.components()[0];
  MetricSettings with = settings();
  EXPECT_EQ(guarded_ellipsoids(steep, range, with)[0].gradient_share, 1);
  with.minimum_radius = 0.1;
  EXPECT_NEAR(guarded_ellipsoids(steep, range, with)[0].gradient_share, 1, 1e-6);
  with.minimum_radius = 0.25;
  EXPECT_NEAR(guarded_ellipsoids(steep, range, with)[0].gradient_share, 0.4, 1e-6);
}

TEST(GuardedEllipsoids, SameBitsForAnyNumberOfThreads) {
  std::vector<Record> records = test::make_cloud(test::Layout::sheets, 4000, 12, 5);
  RandomStream random(3, 0, 0, 0);
  for (Record& record : records) record.radiance *= 0.9f + 0.2f * random.next_float();
  const RecordSet set(records);
  const ComponentRange& range = set.components()[0];
  std::vector<std::vector<Ellipsoid>> results;
  for (const size_t threads : {1, 2, 7}) {
    const tbb::global_control limit(tbb::global_control::max_allowed_parallelism, threads);
    results.push_back(guarded_ellipsoids(set, range, test::cloud_settings()));
  }
  bool shrunk = false;
  for (size_t i = 0; i < range.place_count; ++i) {
    for (const auto& other : results) EXPECT_EQ(other[i].semi_axes, results[0][i].semi_axes);
    shrunk |= results[0][i].semi_axes !=
              base_ellipsoid(test::cloud_settings(), set.place(range, static_cast<uint32_t>(i))).semi_axes;
  }
  EXPECT_TRUE(shrunk);
}

}  // namespace
}  // namespace fogbank::cache
