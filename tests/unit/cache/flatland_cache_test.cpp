// The two-dimensional cache: guards against geometry, extents as functions of the set, and the figures of the
// method.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <numeric>

#include "cache/flatland/fill.h"
#include "core/error.h"
#include "core/random.h"
#include "derivatives/flatland_scenes.h"

namespace fogbank::cache::flatland {
namespace {

namespace flatland = derivatives::flatland;
using flatland::Method;
using flatland::SceneDescription;
using flatland::Zone;

constexpr double infinity = std::numeric_limits<double>::infinity();

Settings second_order(double threshold, double pixel) {
  Settings settings;
  settings.threshold = threshold;
  settings.maximum_radius = 0.25;
  settings.minimum_radius = 0.99 * pixel;
  return settings;
}

std::shared_ptr<const flatland::Model> model_of(const SceneDescription& scene, Method method,
                                                int32_t samples) {
  flatland::Settings settings;
  settings.method = method;
  settings.order = derivatives::Order::single;
  settings.samples = samples;
  return std::make_shared<flatland::Model>(scene, settings);
}

/// Pixel centres of the unit box from coarse to fine, the first 64 on a regular grid. Moved off the scenes'
/// round coordinates.
std::vector<Vec2d> picture_points(int side) {
  std::vector<Vec2d> points;
  std::vector<bool> listed(static_cast<size_t>(side) * static_cast<size_t>(side));
  for (int stride = side / 8; stride >= 1; stride /= 2) {
    for (int row = stride / 2; row < side; row += stride) {
      for (int column = stride / 2; column < side; column += stride) {
        const auto place = static_cast<size_t>(row) * static_cast<size_t>(side) + static_cast<size_t>(column);
        if (listed[place]) continue;
        listed[place] = true;
        points.emplace_back((column + 0.5003) / side, (row + 0.5003) / side);
      }
    }
  }
  return points;
}

struct Quality {
  size_t records = 0;
  double penumbra = 0;  ///< RMSE over the mean there
  double whole = 0;
};

Quality quality(const SceneDescription& scene, Method method, int32_t samples, const Settings& settings,
                int side) {
  const std::vector<Vec2d> points = picture_points(side);
  Fill fill(model_of(scene, method, samples), settings, points, 64);
  while (fill.advance(1000)) {
  }
  const flatland::Scene exact(scene);
  double sums[2] = {0, 0};
  double squares[2] = {0, 0};
  double counts[2] = {0, 0};
  for (size_t i = 0; i < points.size(); ++i) {
    const double truth = flatland::direct_radiance<double>(exact, points[i]);
    const double error = fill.radiance()[i] - truth;
    const bool penumbra = zone_of(scene, points[i]) == Zone::penumbra;
    for (int k = 0; k <= (penumbra ? 1 : 0); ++k) {
      sums[k] += truth;
      squares[k] += error * error;
      counts[k] += 1;
    }
  }
  const auto relative = [&](int k) { return std::sqrt(squares[k] / counts[k]) / (sums[k] / counts[k]); };
  return {fill.cache().size(), relative(1), relative(0)};
}

TEST(FlatlandMargin, NoLightChangesItsVisibilityWithinIt) {
  const SceneDescription description = flatland::box_scene();
  const flatland::Scene scene(description);
  int bounded = 0;
  for (const Zone zone : {Zone::lit, Zone::umbra}) {
    for (const Vec2d& x : flatland::box_points(zone, 24)) {
      const double margin = visibility_margin(scene, flatland::make_ring(scene, x, 256, 6, 1), x);
      ASSERT_GT(margin, 0);
      if (margin == infinity) continue;
      ++bounded;
      for (int k = 0; k < 16; ++k) {
        const double angle = 2 * std::numbers::pi * k / 16;
        const Vec2d there = x + 0.99 * margin * Vec2d(std::cos(angle), std::sin(angle));
        const bool inside = there.x > 0 && there.x < 1 && there.y > 0 && there.y < 1;
        // A record doesn't look through surfaces.
        const flatland::Hit hit = scene.trace(x, glm::normalize(there - x));
        if (inside && hit.distance > glm::distance(x, there)) {
          EXPECT_EQ(zone_of(description, there), zone)
              << x.x << ' ' << x.y << " to " << there.x << ' ' << there.y;
        }
      }
    }
  }
  EXPECT_GT(bounded, 100);
}

TEST(FlatlandMargin, IsTheDistanceToTheShadowsBorder) {
  const flatland::Scene scene(flatland::box_scene());
  // Lit, to the right of the penumbra of the occluder's right end (0.5, 0.55) and the light's left one.
  const Vec2d lit(0.75, 0.3);
  // In the umbra: left of the line through the light's right end.
  const Vec2d umbra(0.2, 0.3);
  const auto distance = [](const Vec2d& x, const Vec2d& a, const Vec2d& b) {
    const flatland::Line line = flatland::line_through(a, b);
    return std::fabs(glm::dot(line.normal, x) - line.offset);
  };
  const Vec2d tip(0.5, 0.55);
  const auto margin = [&](const Vec2d& x) {
    return visibility_margin(scene, flatland::make_ring(scene, x, 4096, 20, 1), x);
  };
  // What is left is the bisected gap, 2^-20 of 2 pi / 4096.
  EXPECT_NEAR(margin(lit), distance(lit, tip, {0.3, 0.95}), 1e-6);
  EXPECT_NEAR(margin(umbra),
              std::min(distance(umbra, tip, {0.7, 0.95}), distance(umbra, {0.1, 0.55}, {0.3, 0.95})), 1e-6);
}

TEST(FlatlandMargin, ALightsOwnLineCounts) {
  SceneDescription description;
  description.segments = {{{0.3, 0.5}, {0.5, 0.5}, 1}};
  const flatland::Scene scene(description);
  const auto margin = [&](const Vec2d& x) {
    return visibility_margin(scene, flatland::make_ring(scene, x, 64, 6, 1), x);
  };
  EXPECT_DOUBLE_EQ(margin({0.8, 0.6}), 0.1);                     // beside it: its line
  EXPECT_DOUBLE_EQ(margin({0.45, 0.6}), std::hypot(0.05, 0.1));  // in front of it: its nearer end
}

TEST(FlatlandDepth, NoOffsetLeadsThroughASurface) {
  const flatland::Scene scene(flatland::crowded_scene());
  const Vec2d x(0.45, 0.2);
  const DepthBins bins(flatland::make_ring(scene, x, 128, 6, 3));
  RandomStream random(5, 0, 0, 0);
  int reached = 0;
  for (int i = 0; i < 2000; ++i) {
    const double angle = 2 * std::numbers::pi * random.next_float();
    const Vec2d direction(std::cos(angle), std::sin(angle));
    const double depth = scene.trace(x, direction).distance;
    // Between two rays a surface may come nearer by the sagitta of a gap, (2 pi / 128)^2 / 8 = 3e-4, and
    // more where it is slanted.
    EXPECT_FALSE(bins.reaches(direction * (1.02 * depth)));
    reached += bins.reaches(direction * (0.8 * depth)) ? 1 : 0;
  }
  // A bin has the depth of the nearest of its surfaces.
  EXPECT_GT(reached, 1200);
}

TEST(FlatlandEllipse, FirstOrderRadiusIsTheThresholdTimesTheChangeLength) {
  Settings settings = second_order(0.5, 0.01);
  settings.metric = Metric::first_order;
  Record record;
  record.mean.value = 2;
  record.mean.gradient = {3, 0};
  record.change_length = 0.2;
  const Ellipse ellipse = base_ellipse(settings, 0.1, record);
  EXPECT_DOUBLE_EQ(ellipse.semi_axes[0], 0.1);
  EXPECT_DOUBLE_EQ(ellipse.semi_axes[1], 0.1);
  EXPECT_DOUBLE_EQ(verify_tolerance(settings, ellipse), 0.5);
  EXPECT_DOUBLE_EQ(extrapolated(settings, record, {0.1, 7}), 2 * std::exp(0.15));
  EXPECT_DOUBLE_EQ(extrapolated(settings, record, {9, 0}), 8);
  record.surroundings.visibility_margin = 0.03;
  EXPECT_DOUBLE_EQ(base_ellipse(settings, 0.1, record).longest(), 0.03);
  record.surroundings.visibility_margin = 1e-9;
  EXPECT_DOUBLE_EQ(base_ellipse(settings, 0.1, record).longest(), settings.minimum_radius);
}

TEST(FlatlandEllipse, TheRivalsRadiusFollowsFromItsSamples) {
  const auto model = model_of(flatland::box_scene(), Method::unaware, 64);
  const Vec2d x(0.8, 0.7);
  const flatland::Estimate estimate = model->estimate(x);
  // Samples don't all change alike, so together they change less.
  EXPECT_GT(estimate.gradient_magnitude, glm::length(estimate.mean.gradient));
  EXPECT_DOUBLE_EQ(make_record(*model, x).change_length, estimate.mean.value / estimate.gradient_magnitude);
  EXPECT_EQ(make_record(*model, {0.25, 0.3}).change_length, infinity);  // nothing to be seen in the umbra
}

TEST(FlatlandCache, ExtentsDoNotDependOnTheOrderOfRecords) {
  const auto model = model_of(flatland::box_scene(), Method::aware, 64);
  std::vector<Record> records;
  RandomStream random(7, 0, 0, 0);
  for (int i = 0; i < 300; ++i)
    records.push_back(make_record(*model, {0.01 + 0.98 * random.next_float(), 0.9 * random.next_float()}));
  const Settings settings = second_order(1e-4, 0.01);
  std::vector<size_t> order(records.size());
  std::iota(order.begin(), order.end(), size_t{0});
  Cache forward(settings, 0.01);
  for (const size_t i : order) forward.add(records[i]);
  std::reverse(order.begin(), order.end());
  std::rotate(order.begin(), order.begin() + 101, order.end());
  Cache shuffled(settings, 0.01);
  for (const size_t i : order) shuffled.add(records[i]);
  for (size_t k = 0; k < order.size(); ++k) {
    EXPECT_EQ(shuffled.extent(k).semi_axes, forward.extent(order[k]).semi_axes);
    EXPECT_LE(forward.extent(k).longest(), settings.maximum_radius);
  }
}

TEST(FlatlandCache, ALinearFieldIsReproduced) {
  const Vec2d slope(0.7, -0.4);
  Cache cache(second_order(1e-3, 0.01), 0.01);
  RandomStream random(3, 0, 0, 0);
  for (int i = 0; i < 60; ++i) {
    Record record;
    record.position = {random.next_float(), random.next_float()};
    record.mean = derivatives::Jet2d::linear(1 + glm::dot(slope, record.position), slope);
    cache.add(record);
  }
  for (int i = 0; i < 100; ++i) {
    const Vec2d x(random.next_float(), random.next_float());
    const std::optional<double> found = cache.look_up(x);
    ASSERT_TRUE(found);
    EXPECT_NEAR(*found, 1 + glm::dot(slope, x), 1e-12);
  }
  EXPECT_FALSE(cache.look_up({3, 3}));
}

TEST(FlatlandFill, StepsOfAnyLengthGiveTheSame) {
  const auto model = model_of(flatland::box_scene(), Method::aware, 32);
  const std::vector<Vec2d> points = picture_points(32);
  const auto filled = [&](size_t step) {
    Fill fill(model, second_order(1e-4, 1.0 / 32), points, 64);
    while (fill.advance(step)) {
    }
    return fill.radiance();
  };
  const std::vector<double> radiance = filled(1);
  EXPECT_EQ(radiance.size(), points.size());
  EXPECT_EQ(radiance, filled(777));
}

TEST(FlatlandFill, DarknessIsDarkEverywhere) {
  SceneDescription scene = flatland::box_scene();
  scene.segments[0].radiance = 0;
  Fill fill(model_of(scene, Method::aware, 16), second_order(1e-4, 1.0 / 16), picture_points(16), 4);
  while (fill.advance(100)) {
  }
  EXPECT_THAT(fill.radiance(), testing::Each(0.0));
  EXPECT_GT(fill.rays(), 0U);
}

TEST(FlatlandFill, RefusalsNameTheField) {
  const auto model = model_of(flatland::box_scene(), Method::aware, 16);
  const auto message = [&](const Settings& settings, size_t pilot) -> std::string {
    try {
      Fill(model, settings, picture_points(16), pilot);
    } catch (const Error& error) {
      EXPECT_EQ(error.reason(), "INVALID_SETTINGS");
      return error.what();
    }
    return "accepted";
  };
  const auto changed = [](auto change) {
    Settings settings = second_order(1e-3, 0.1);
    change(settings);
    return settings;
  };
  using testing::StartsWith;
  EXPECT_THAT(message(changed([](Settings& s) { s.threshold = 0; }), 1), StartsWith("threshold: "));
  EXPECT_THAT(message(changed([](Settings& s) { s.maximum_anisotropy = 0.5; }), 1),
              StartsWith("maximum_anisotropy: "));
  EXPECT_THAT(message(changed([](Settings& s) { s.maximum_radius = -1; }), 1),
              StartsWith("maximum_radius: "));
  EXPECT_THAT(message(changed([](Settings& s) { s.minimum_radius = NAN; }), 1),
              StartsWith("minimum_radius: "));
  EXPECT_THAT(message(changed([](Settings&) {}), 0), StartsWith("pilot: "));
  EXPECT_THAT(message(changed([](Settings&) {}), 257), StartsWith("pilot: "));
  EXPECT_EQ(message(changed([](Settings&) {}), 256), "accepted");
}

// method.md section 16: 0.014 at 1020 records for the aware method with its fixes, 0.18 for the unaware one.
// Here 0.012 at 1138 and 0.19 at 1338.
TEST(FlatlandFill, AwareRecordsCarryPenumbraeAndUnawareOnesDoNot) {
  const Settings settings = second_order(1.6e-5, 1.0 / 128);
  const SceneDescription scene = flatland::box_scene();
  const Quality aware = quality(scene, Method::aware, 256, settings, 128);
  const Quality unaware = quality(scene, Method::unaware, 256, settings, 128);
  EXPECT_NEAR(static_cast<double>(aware.records), 1100, 150);
  EXPECT_LT(aware.penumbra, 0.02);
  EXPECT_LT(aware.whole, 0.02);
  EXPECT_GT(unaware.records, aware.records);
  EXPECT_GT(unaware.penumbra, 5 * aware.penumbra);
}

// Without the guards the umbra's records, whose derivatives all are 0, cover the penumbra for any threshold:
// 0.70 at 2500 records.
TEST(FlatlandFill, DerivativesAloneDoNotSeeWhereShadowsBegin) {
  Settings settings = second_order(4e-6, 1.0 / 64);
  settings.guards.visibility_margin = settings.guards.verify = false;
  EXPECT_GT(quality(flatland::box_scene(), Method::exact, 64, settings, 64).penumbra, 0.2);
}

}  // namespace
}  // namespace fogbank::cache::flatland
