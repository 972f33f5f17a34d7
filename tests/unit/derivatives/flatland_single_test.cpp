// Single scattering in two dimensions: the exact answer against finite differences and closed forms, the
// estimates against the exact answer (method.md section 16).
#include <gtest/gtest.h>

#include "core/error.h"
#include "derivatives/flatland_scenes.h"

namespace fogbank::derivatives::flatland {
namespace {

Errors errors_of(const Settings& settings, Zone zone, int n) {
  const SceneDescription description = box_scene();
  const Model model(description, settings);
  const Scene scene(description);
  return measure(
      box_points(zone, n), [&](const Vec2d& x) { return model.estimate(x).mean; },
      [&](const Vec2d& x) { return direct_radiance<Jet2d>(scene, x); });
}

Settings unaware_settings(int32_t samples) {
  Settings settings;
  settings.method = Method::unaware;
  settings.order = Order::single;
  settings.samples = samples;
  return settings;
}

Settings corrected_settings(int32_t samples) {
  Settings settings;
  settings.order = Order::single;
  settings.samples = samples;
  return settings;
}

TEST(FlatlandExact, IsTheAngleOfTheVisiblePartsWithoutMedium) {
  SceneDescription description = box_scene(0);
  const Scene scene(description);
  // The occluder's right end hides the light left of x = 0.62 from here.
  const Vec2d x(0.4, 0.15);
  const auto angle_to = [&](const Vec2d& v) { return std::atan2(v.y - x.y, v.x - x.x); };
  const double expected = (angle_to({0.5, 0.55}) - angle_to({0.7, 0.95})) / (2 * std::numbers::pi);
  EXPECT_NEAR(direct_radiance<double>(scene, x), expected, 1e-15);
  EXPECT_EQ(direct_radiance<double>(scene, {0.2, 0.4}), 0);
}

TEST(FlatlandExact, DerivativesAreThoseOfFiniteDifferences) {
  for (const SceneDescription& description : {box_scene(), crowded_scene()}) {
    const Scene scene(description);
    const Vec2d extent = description.box_max - description.box_min;
    int compared = 0;
    for (int i = 0; i < 400; ++i) {
      // Points of a lattice that meets no symmetry of the scenes.
      const Vec2d x = description.box_min + extent * Vec2d(std::fmod(0.5 + i * 0.7548776662, 1.0),
                                                           std::fmod(0.5 + i * 0.5698402910, 1.0));
      const auto value = [&](const Vec2d& y) { return direct_radiance<double>(scene, y); };
      const Jet2d coarse = finite_differences(value, x, 4e-4);
      const Jet2d fine = finite_differences(value, x, 2e-4);
      const Jet2d exact = direct_radiance<Jet2d>(scene, x);
      EXPECT_NEAR(exact.value, value(x), 1e-14);
      // Where a crease or an end of a light is near, the differences don't agree with themselves
      // (Richardson's check).
      const double scale = 1 + fine.hessian.norm();
      if ((coarse.hessian - fine.hessian).norm() > 1e-5 * scale) continue;
      ++compared;
      // Rounding of values near 1 over a step of 2e-4: 1e-16 / 4e-8 = 2.5e-9, times the weights of the
      // formula.
      EXPECT_NEAR(glm::length(exact.gradient - fine.gradient), 0, 1e-7 * scale);
      EXPECT_NEAR((exact.hessian - fine.hessian).norm(), 0, 2e-6 * scale) << x.x << ", " << x.y;
    }
    EXPECT_GT(compared, 300);
  }
}

TEST(FlatlandAware, PlainSchemeConvergesInPenumbrae) {
  // Over 12 seeds: 2.99 +- 0.27 % at 256, 0.54 +- 0.03 % at 1024.
  EXPECT_LE(errors_of(plain_settings(Order::single, 256), Zone::penumbra, 48).gradient, 0.03);
  const Errors errors = errors_of(plain_settings(Order::single, 1024), Zone::penumbra, 48);
  EXPECT_LE(errors.gradient, 0.006);
  EXPECT_LE(errors.median_angle, 0.5);
  // The plateau of method.md section 6.4: 8.5 % however many rays.
  EXPECT_NEAR(errors.hessian, 0.085, 0.01);
}

TEST(FlatlandAware, AllCorrectionsTogetherAreExactToTwoPerMille) {
  for (const Zone zone : {Zone::lit, Zone::penumbra}) {
    const Errors errors = errors_of(corrected_settings(256), zone, 48);
    EXPECT_LE(errors.gradient, 0.002);
    EXPECT_LE(errors.hessian, 0.002);
    EXPECT_LE(std::abs(errors.value), 0.001);
  }
}

TEST(FlatlandAware, BisectionAloneLeavesTheHessianAtItsPlateau) {
  Settings settings = plain_settings(Order::single, 256);
  settings.bisections = 8;
  const Errors errors = errors_of(settings, Zone::penumbra, 48);
  EXPECT_LE(errors.gradient, 0.003);
  EXPECT_NEAR(errors.hessian, 0.085, 0.01);
}

TEST(FlatlandAware, TriangulatedValueIsBiasedTheStratifiedMeanIsNot) {
  const Model model(box_scene(), plain_settings(Order::single, 256));
  const Scene scene(box_scene());
  double truth = 0;
  double triangulated = 0;
  double stratified = 0;
  for (const Vec2d& x : box_points(Zone::lit, 48)) {
    const Estimate estimate = model.estimate(x);
    truth += direct_radiance<double>(scene, x);
    triangulated += estimate.mean.value;
    stratified += estimate.stratified_mean;
  }
  EXPECT_NEAR(triangulated / truth - 1, -0.034, 0.006);
  EXPECT_NEAR(stratified / truth - 1, 0, 0.002);
}

TEST(FlatlandAware, RatioRemovesTheBiasOfFullyLitLights) {
  Settings settings = plain_settings(Order::single, 256);
  const double plain = errors_of(settings, Zone::lit, 48).gradient;
  settings.ratio = true;
  EXPECT_LT(errors_of(settings, Zone::lit, 48).gradient, 0.85 * plain);
}

TEST(FlatlandAware, SlantedSurfacesAndSeveralLightsConverge) {
  const SceneDescription description = crowded_scene();
  const Model model(description, corrected_settings(1024));
  const Scene scene(description);
  std::vector<Vec2d> points;
  for (int i = 0; i < 200; ++i) {
    const Vec2d x = description.box_min + Vec2d(2.5, 1.5) * Vec2d(std::fmod(0.5 + i * 0.7548776662, 1.0),
                                                                  std::fmod(0.5 + i * 0.5698402910, 1.0));
    bool clear = true;
    for (const Segment& segment : description.segments) {
      clear = clear && glm::distance(x, segment.start) > 0.1 && glm::distance(x, segment.end) > 0.1 &&
              glm::distance(x, (segment.start + segment.end) / 2.0) > 0.2;
    }
    if (clear) points.push_back(x);
  }
  ASSERT_GT(points.size(), 100u);
  const Errors errors = measure(
      points, [&](const Vec2d& x) { return model.estimate(x).mean; },
      [&](const Vec2d& x) { return direct_radiance<Jet2d>(scene, x); });
  // A gap that a bisection leaves open is 2 pi / 1024 / 2^8; the rest is the mean rule's error, second order
  // in the spacing.
  EXPECT_LE(errors.gradient, 0.005);
  EXPECT_LE(errors.hessian, 0.01);
}

TEST(FlatlandUnaware, MissesPenumbraeHoweverManySamples) {
  for (const int32_t samples : {256, 1024}) {
    const Errors errors = errors_of(unaware_settings(samples), Zone::penumbra, 48);
    EXPECT_NEAR(errors.median_angle, 60, 5);
    EXPECT_NEAR(errors.gradient, 0.91, 0.03);
    EXPECT_NEAR(errors.hessian, 0.97, 0.03);
  }
}

TEST(FlatlandUnaware, IsRightWhereNothingOccludes) {
  const Errors errors = errors_of(unaware_settings(1024), Zone::lit, 48);
  EXPECT_LE(errors.gradient, 0.01);
  EXPECT_LE(errors.hessian, 0.01);
}

TEST(Flatland, UmbraIsExactlyZeroForEveryMethod) {
  Settings exact;
  exact.method = Method::exact;
  exact.order = Order::single;
  for (const Settings& settings : {exact, unaware_settings(64), plain_settings(Order::single, 64),
                                   corrected_settings(64), corrected_settings(256)}) {
    const Model model(box_scene(), settings);
    for (const Vec2d& x : box_points(Zone::umbra, 16)) {
      const Estimate estimate = model.estimate(x);
      EXPECT_EQ(estimate.mean.value, 0);
      EXPECT_EQ(estimate.mean.gradient, Vec2d(0));
      EXPECT_EQ(estimate.mean.hessian.norm(), 0);
      EXPECT_EQ(estimate.stratified_mean, 0);
    }
  }
}

TEST(Flatland, AnswersDependOnSceneSettingsAndPointAlone) {
  const Model first(crowded_scene(), corrected_settings(128));
  const Model second(crowded_scene(), corrected_settings(128));
  const Vec2d points[] = {{0.31, -0.2}, {-0.6, 0.2}, {0.9, 0.33}};
  const Estimate before = first.estimate(points[0]);
  for (const Vec2d& x : points) {
    const Estimate a = first.estimate(x);
    const Estimate b = second.estimate(x);
    EXPECT_EQ(a.mean.value, b.mean.value);
    EXPECT_EQ(a.mean.gradient, b.mean.gradient);
    EXPECT_EQ(a.mean.hessian.entries, b.mean.hessian.entries);
  }
  EXPECT_EQ(first.estimate(points[0]).mean.value, before.mean.value);
}

TEST(Flatland, AnswersScaleWithTheScene) {
  constexpr double scale = 64;  // a power of two, so that all roundings are the same
  SceneDescription small = crowded_scene();
  SceneDescription large = small;
  large.box_min *= scale;
  large.box_max *= scale;
  large.sigma_t /= scale;
  for (Segment& segment : large.segments) {
    segment.start *= scale;
    segment.end *= scale;
  }
  Settings settings;
  settings.method = Method::exact;
  settings.order = Order::single;
  const Vec2d x(0.31, -0.2);
  const Jet2d a = Model(small, settings).estimate(x).mean;
  const Jet2d b = Model(large, settings).estimate(x * scale).mean;
  EXPECT_NEAR(b.value, a.value, 1e-14);
  EXPECT_NEAR(glm::length(b.gradient * scale - a.gradient), 0, 1e-13);
  EXPECT_NEAR((b.hessian * (scale * scale) - a.hessian).norm(), 0, 1e-12);
}

TEST(Flatland, ExtremeInputsGiveFiniteNumbers) {
  for (const double sigma_t : {0.0, 1e-9, 1e3, largest_number}) {
    SceneDescription description = crowded_scene();
    description.sigma_t = sigma_t;
    for (Segment& segment : description.segments) segment.radiance *= largest_number / 2;
    for (const Method method : {Method::exact, Method::unaware, Method::aware}) {
      Settings settings;
      settings.method = method;
      settings.order = Order::single;
      settings.samples = 64;
      const Model model(description, settings);
      const double margin = 3e-9;
      for (const Vec2d& x : {Vec2d(-1 + margin, 0.3), Vec2d(0.95, 0.9 - margin), Vec2d(1.2 + margin, 0.9),
                             Vec2d(0.1, 0.9), Vec2d(0.2 + margin, 0.05), Vec2d(1.5 - margin, 1 - margin)}) {
        const Jet2d jet = model.estimate(x).mean;
        EXPECT_TRUE(std::isfinite(jet.value) && std::isfinite(glm::length(jet.gradient)) &&
                    std::isfinite(jet.hessian.norm()))
            << static_cast<int>(method) << " at " << x.x << ", " << x.y << ", sigma_t " << sigma_t;
      }
    }
  }
}

void expect_refusal(const SceneDescription& scene, const Settings& settings, const std::string& reason,
                    const std::string& field) {
  try {
    const Model model(scene, settings);
    ADD_FAILURE() << field << " was accepted";
  } catch (const Error& error) {
    EXPECT_EQ(error.reason(), reason);
    EXPECT_EQ(std::string(error.what()).substr(0, field.size() + 2), field + ": ");
  }
}

TEST(Flatland, BadScenesAreRefusedByField) {
  const auto refuse = [](const std::string& field, const auto& damage) {
    SceneDescription scene = box_scene();
    damage(scene);
    expect_refusal(scene, {}, "INVALID_SCENE", field);
  };
  constexpr double nan = std::numeric_limits<double>::quiet_NaN();
  refuse("box_min", [](SceneDescription& s) { s.box_min.x = nan; });
  refuse("box_max", [](SceneDescription& s) { s.box_max.y = 0; });
  refuse("sigma_t", [](SceneDescription& s) { s.sigma_t = -1; });
  refuse("albedo", [](SceneDescription& s) { s.albedo = 1.5; });
  refuse("segments[0].radiance", [](SceneDescription& s) { s.segments[0].radiance = nan; });
  refuse("segments[1].start", [](SceneDescription& s) { s.segments[1].start.x = -0.1; });
  refuse("segments[1].end", [](SceneDescription& s) { s.segments[1].end.y = INFINITY; });
  refuse("segments[1]", [](SceneDescription& s) { s.segments[1].end = s.segments[1].start; });
  refuse("segments",
         [](SceneDescription& s) { s.segments.resize(largest_segment_count + 1, s.segments[0]); });
}

TEST(Flatland, BadSettingsAndPointsAreRefused) {
  const auto refuse = [](const std::string& field, const auto& damage) {
    Settings settings;
    damage(settings);
    expect_refusal(box_scene(), settings, "INVALID_SETTINGS", field);
  };
  refuse("samples", [](Settings& s) { s.samples = 3; });
  refuse("samples", [](Settings& s) { s.samples = largest_sample_count + 1; });
  refuse("bisections", [](Settings& s) { s.bisections = -1; });
  refuse("march_step", [](Settings& s) { s.march_step = -1; });
  refuse("march_step", [](Settings& s) { s.march_step = 1e-6; });
  const Model model(box_scene(), Settings{});
  for (const Vec2d& x : {Vec2d(1.5, 0.5), Vec2d(0.5, 1), Vec2d(0.4, 0.95), Vec2d(NAN, 0.5)})
    EXPECT_THROW(static_cast<void>(model.estimate(x)), Error);
}

}  // namespace
}  // namespace fogbank::derivatives::flatland
