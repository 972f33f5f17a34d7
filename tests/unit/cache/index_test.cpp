#include "cache/index.h"

#include <gtest/gtest.h>
#include <tbb/global_control.h>
#include <tbb/parallel_for.h>

#include <array>
#include <bit>
#include <cstring>

#include "cache/extents.h"
#include "core/error.h"
#include "record_clouds.h"

namespace fogbank::cache {
namespace {

using test::Layout;

/// Definition of a look-up, record by record in double precision.
struct Expected {
  Vec3d radiance{0};
  double weight = 0;
  uint32_t records = 0;
  uint32_t rejected = 0;
  double inverse_axes = 0;  ///< weights times sums of reciprocals of semi-axes
  /// The point is so close to a border that rounding decides.
  bool near_border = false;
};

Expected brute_force(const RecordSet& set, const ComponentRange& range,
                     const std::vector<Ellipsoid>& ellipsoids, bool depth_guard, const Vec3f& point) {
  Expected result;
  for (uint32_t i = 0; i < range.place_count; ++i) {
    const Place place = set.place(range, i);
    if (ellipsoids[i].empty()) continue;
    const Vec3d offset = Vec3d(point) - Vec3d(place.position);
    double squared = 0;
    for (size_t k = 0; k < 3; ++k) {
      const double along =
          glm::dot(Vec3d(ellipsoids[i].axes[k]), offset) / static_cast<double>(ellipsoids[i].semi_axes[k]);
      squared += along * along;
    }
    // Shapes are rounded to floats, positions are subtracted as floats.
    const double aspect = static_cast<double>(ellipsoids[i].longest() / ellipsoids[i].shortest());
    if (std::fabs(squared - 1) < 4e-6 * aspect) result.near_border = true;
    if (squared >= 1) continue;
    bool reaches = true;
    for (uint32_t record = range.begin(i); record < range.end(i); ++record)
      reaches &= set.depth()[range.first_record + record].reaches(point - place.position);
    if (depth_guard && !reaches) {
      ++result.rejected;
      continue;
    }
    const double d = 1 - std::sqrt(squared);
    const double weight = d * d * (3 - 2 * d);
    Vec3d value(0);
    for (int channel = 0; channel < 3; ++channel)
      value[channel] = std::clamp(
          static_cast<double>(place.radiance[channel]) +
              static_cast<double>(ellipsoids[i].gradient_share) *
                  glm::dot(Vec3d(place.gradient[static_cast<size_t>(channel)]), offset),
          0.0, 3 * std::max<double>(place.radiance[channel], test::cloud_settings().radiance_floor));
    result.radiance += weight * value;
    result.weight += weight;
    for (const float a : ellipsoids[i].semi_axes) result.inverse_axes += weight / static_cast<double>(a);
    ++result.records;
  }
  if (result.weight > 0) result.radiance /= result.weight;
  return result;
}

void expect_agreement(const std::vector<Record>& records, const MetricSettings& settings, size_t points) {
  const auto set = std::make_shared<RecordSet>(records);
  const Epoch epoch(set, settings);
  const ComponentRange& range = set->components()[0];
  const Index* index = epoch.find(range.component);
  ASSERT_NE(index, nullptr);
  const std::vector<Ellipsoid> ellipsoids = guarded_ellipsoids(*set, range, settings);
  RandomStream random(9, 0, 0, 0);
  size_t compared = 0;
  for (size_t n = 0; n < points; ++n) {
    // A third each: anywhere, at records, close to records.
    Vec3f point(random.next_float(), random.next_float(), random.next_float());
    const auto number = static_cast<uint32_t>(random.next_float() * static_cast<float>(range.place_count));
    if (n % 3 != 0) point = set->place(range, number).position;
    if (n % 3 == 2)
      point += 0.9f * ellipsoids[number].shortest() * square_to_uniform_sphere(random.next_vec2());
    const Expected expected = brute_force(*set, range, ellipsoids, settings.guards.depth, point);
    if (expected.near_border) continue;
    ++compared;
    const Interpolation found = index->look_up(point);
    EXPECT_EQ(found.records, expected.records);
    EXPECT_EQ(found.rejected, expected.rejected);
    // Weights near a border are small squares of differences; single precision keeps the sums to 1e-5 of the
    // number of records.
    EXPECT_NEAR(found.weight, expected.weight, 1e-5 * (1 + expected.records));
    const std::vector<Contribution> contributions = index->contributions(point, Vec3f(0));
    EXPECT_EQ(contributions.size(), expected.records);
    double inverse_radii = 0;
    for (const Contribution& contribution : contributions)
      inverse_radii += static_cast<double>(contribution.weight / contribution.radius);
    if (expected.weight < 1e-3) continue;
    EXPECT_NEAR(3 * inverse_radii, expected.inverse_axes, 1e-2 * expected.inverse_axes);
    EXPECT_NEAR(found.radius, 3 * expected.weight / expected.inverse_axes, 1e-2 * found.radius);
    for (int channel = 0; channel < 3; ++channel)
      EXPECT_NEAR(found.radiance[channel], expected.radiance[channel],
                  2e-4 * (1 + expected.radiance[channel]));
  }
  EXPECT_GT(compared, points / 2);
}

/// Depths, colours and steep gradients that cross zero.
std::vector<Record> lively(std::vector<Record> records, float slope) {
  RandomStream random(8, 0, 0, 0);
  for (Record& record : records) {
    for (int i = 0; i < 8; ++i)
      record.depth.insert(square_to_uniform_sphere(random.next_vec2()), 0.2f * random.next_float());
    for (int channel = 0; channel < 3; ++channel) {
      record.radiance[channel] = random.next_float();
      record.gradient[static_cast<size_t>(channel)] = slope * square_to_uniform_sphere(random.next_vec2());
    }
  }
  return records;
}

class IndexSizes : public testing::TestWithParam<size_t> {};

TEST_P(IndexSizes, AgreesWithBruteForce) {
  for (const Layout layout : {Layout::uniform, Layout::sheets}) {
    const std::vector<Record> cloud = test::make_cloud(layout, GetParam(), 12, 1);
    const size_t points = GetParam() > 10000 ? 60 : 600;
    expect_agreement(cloud, test::cloud_settings(), points);
    MetricSettings unguarded = test::cloud_settings();
    unguarded.guards.verify = unguarded.guards.neighbour_clamp = false;
    expect_agreement(lively(cloud, 5), unguarded, points);
    unguarded.shape = Shape::sphere;
    unguarded.guards.depth = false;
    expect_agreement(lively(cloud, 5), unguarded, points);
  }
}

TEST(Index, WidenedExtentsAgreeWithBruteForce) {
  MetricSettings widened = test::cloud_settings();
  widened.minimum_radius = 0.1;
  expect_agreement(lively(test::make_cloud(Layout::uniform, 513, 12, 1), 20), widened, 600);
}

INSTANTIATE_TEST_SUITE_P(Sizes, IndexSizes, testing::Values(1, 2, 8, 9, 63, 64, 65, 513, 100000));

TEST(Index, HugeAnisotropy) {
  std::vector<Record> records = test::make_cloud(Layout::uniform, 300, 12, 2);
  RandomStream random(4, 0, 0, 0);
  for (Record& record : records) {
    const std::array<Vec3f, 3> frame = test::random_frame(random);
    record.hessian = 1e4f * Symmetric3f::outer(frame[0]) + 1e-2f * Symmetric3f::outer(frame[1]);
  }
  MetricSettings settings = test::cloud_settings();
  settings.maximum_anisotropy = 1000;
  settings.guards.verify = settings.guards.neighbour_clamp = false;
  expect_agreement(records, settings, 600);
}

TEST(Index, ZeroRadiusHoldsNothing) {
  std::vector<Record> records = test::make_cloud(Layout::uniform, 40, 12, 3);
  for (Record& record : records) record.visibility_margin = 1e-45f;
  for (float& entry : records[0].hessian.entries) entry = 3e38f;
  expect_agreement(records, test::cloud_settings(), 100);
}

TEST(Index, ManyRecordsAroundOnePoint) {
  // More than any buffer of the search holds: chunks must come in order and miss nothing.
  std::vector<Record> records;
  RandomStream random(5, 0, 0, 0);
  for (uint32_t i = 0; i < 30000; ++i) {
    Record record;
    record.position = Vec3f(0.5f) + 0.01f * square_to_uniform_sphere(random.next_vec2());
    record.id = content_id(record.position, {}, "many", i);
    record.radiance = Spectrum(1);
    records.push_back(record);
  }
  MetricSettings settings = test::cloud_settings();
  settings.guards.verify = false;
  const auto set = std::make_shared<RecordSet>(records);
  const Epoch epoch(set, settings);
  const Interpolation found = epoch.find({})->look_up(Vec3f(0.5f));
  EXPECT_EQ(found.records, 30000u);
  EXPECT_NEAR(found.radiance.x, 1, 1e-3f);
}

TEST(Index, RecordsOfAPlaceCombine) {
  std::vector<Record> records = lively(test::make_cloud(Layout::uniform, 400, 12, 6), 5);
  for (size_t i = 0; i < 400; i += 2) records[i + 1].position = records[i].position;
  for (size_t i = 0; i < 400; ++i) records[i].samples = 1 + static_cast<uint32_t>(i) % 7;
  MetricSettings settings = test::cloud_settings();
  settings.guards.verify = settings.guards.neighbour_clamp = false;
  expect_agreement(records, settings, 600);
}

TEST(Index, ExtremeValuesStayFinite) {
  std::vector<Record> records = test::make_cloud(Layout::uniform, 100, 12, 7);
  for (size_t i = 0; i < records.size(); ++i) {
    records[i].radiance = Spectrum(i % 3 == 0 ? 3e38f : 1e-45f);
    records[i].gradient.fill(Vec3f(i % 2 == 0 ? 3e38f : -3e38f));
    if (i % 5 == 0) records[i].hessian = Symmetric3f::identity(3e38f);
  }
  MetricSettings settings = test::cloud_settings();
  settings.minimum_radius = 0.2;
  const auto set = std::make_shared<RecordSet>(records);
  const Epoch epoch(set, settings);
  RandomStream random(6, 0, 0, 0);
  for (int i = 0; i < 200; ++i) {
    const Interpolation found =
        epoch.find({})->look_up({random.next_float(), random.next_float(), random.next_float()});
    EXPECT_TRUE(is_finite(found.radiance));
    EXPECT_GE(min_component(found.radiance), 0);
    EXPECT_TRUE(std::isfinite(found.weight));
  }
  for (const float far : {1e38f, -infinity, std::nanf("")})
    EXPECT_EQ(epoch.find({})->look_up(Vec3f(far)).weight, 0);
}

TEST(Index, SameBitsForAnyNumberOfThreadsAndAnyOrderOfRecords) {
  std::vector<Record> records = lively(test::make_cloud(Layout::sheets, 3000, 12, 10), 2);
  std::vector<Interpolation> first;
  for (const size_t threads : {1, 2, 7}) {
    std::rotate(records.begin(), records.begin() + 777, records.end());
    const tbb::global_control limit(tbb::global_control::max_allowed_parallelism, threads);
    const Epoch epoch(std::make_shared<RecordSet>(records), test::cloud_settings());
    std::vector<Interpolation> found(2000);
    tbb::parallel_for(size_t{0}, found.size(), [&](size_t i) {
      RandomStream random(11, static_cast<uint32_t>(i), 0, 0);
      found[i] = epoch.find({})->look_up({random.next_float(), random.next_float(), random.next_float()});
    });
    if (first.empty()) first = found;
    EXPECT_EQ(std::memcmp(first.data(), found.data(), found.size() * sizeof(Interpolation)), 0);
  }
}

TEST(Index, PointsTogetherGiveTheSameBitsAsOneByOne) {
  // Close together, far apart, and mixed, also at sizes that aren't whole packets.
  MetricSettings wide = test::cloud_settings();
  wide.maximum_anisotropy = 30;
  const Epoch epoch(std::make_shared<RecordSet>(lively(test::make_cloud(Layout::sheets, 3000, 12, 14), 2)),
                    wide);
  const Index& index = *epoch.find({});
  RandomStream random(12, 0, 0, 0);
  std::vector<Vec3f> points;
  for (int group = 0; group < 300; ++group) {
    const Vec3f centre(random.next_float(), random.next_float(), random.next_float());
    const float spread = std::pow(10.0f, -4 * random.next_float());
    for (int i = 0; i < 7; ++i)
      points.push_back(centre + spread * square_to_uniform_sphere(random.next_vec2()));
  }
  using Bits = std::array<uint32_t, sizeof(Interpolation) / sizeof(uint32_t)>;
  std::vector<Interpolation> together(points.size());
  index.look_up(points, together);
  uint32_t records = 0;
  for (size_t i = 0; i < points.size(); ++i) {
    const Interpolation alone = index.look_up(points[i]);
    EXPECT_EQ(std::bit_cast<Bits>(alone), std::bit_cast<Bits>(together[i]));
    records += alone.records;
  }
  EXPECT_GT(records, points.size());
}

TEST(Epoch, ComponentsAreKeptApart) {
  std::vector<Record> records = test::make_cloud(Layout::uniform, 300, 12, 12);
  for (size_t i = 0; i < records.size(); ++i) {
    records[i].component = {static_cast<int32_t>(i % 2), 0, static_cast<uint8_t>(i % 3)};
    records[i].radiance = Spectrum(static_cast<float>(i % 6));
    records[i].gradient = {};
  }
  const auto set = std::make_shared<RecordSet>(records);
  const Epoch epoch(set, test::cloud_settings());
  for (int i = 0; i < 6; ++i) {
    const Index* index = epoch.find({i % 2, 0, static_cast<uint8_t>(i % 3)});
    ASSERT_NE(index, nullptr);
    for (const ComponentRange& range : set->components()) {
      if (range.component != index->component()) continue;
      EXPECT_FLOAT_EQ(index->look_up(set->place(range, 0).position).radiance.x, static_cast<float>(i));
    }
  }
  EXPECT_EQ(epoch.find({2, 0, 0}), nullptr);
  EXPECT_EQ(epoch.find({0, 1, 0}), nullptr);
}

TEST(Epoch, EmptySet) {
  const Epoch epoch(std::make_shared<RecordSet>(), test::cloud_settings());
  EXPECT_EQ(epoch.find({}), nullptr);
}

TEST(Epoch, RefusesBadSettings) {
  MetricSettings settings = test::cloud_settings();
  settings.threshold = -1;
  EXPECT_THROW(Epoch(std::make_shared<RecordSet>(), settings), Error);
}

TEST(Epoch, TakesAtMost200BytesARecord) {
  const auto set = std::make_shared<RecordSet>(test::make_cloud(Layout::uniform, 100000, 12, 13));
  const Epoch epoch(set, test::cloud_settings());
  EXPECT_LE(static_cast<double>(epoch.memory()) / static_cast<double>(set->size()), 200);
}

}  // namespace
}  // namespace fogbank::cache
