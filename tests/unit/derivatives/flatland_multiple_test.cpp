// Multiple scattering in two dimensions: the quadrature against finite differences and closed forms, the
// marches against the quadrature (method.md section 8).
#include <gtest/gtest.h>

#include "core/error.h"
#include "derivatives/flatland/aware.h"
#include "derivatives/flatland/ring_segments.h"
#include "derivatives/flatland/scattered_radiance.h"
#include "derivatives/flatland_scenes.h"
#include "derivatives/transmittance_jet.h"

namespace fogbank::derivatives::flatland {
namespace {

/// A source that is smooth everywhere.
class SmoothSource final : public Source {
 public:
  using Field = Jet2d (*)(const Jet2d& x, const Jet2d& y);
  explicit SmoothSource(Field field) : field_(field) {}
  double value(const Vec2d& y) const override { return jet(y).value; }
  Jet2d jet(const Vec2d& y) const override {
    return field_(Jet2d::linear(y.x, {1, 0}), Jet2d::linear(y.y, {0, 1}));
  }
  std::vector<Line> creases() const override { return {}; }

 private:
  Field field_;
};

Jet2d uniform(const Jet2d& /*x*/, const Jet2d& /*y*/) { return Jet2d::constant(1.5); }
Jet2d slope(const Jet2d& x, const Jet2d& y) { return Jet2d::constant(1) + x * 0.7 + y * 0.4; }
Jet2d hill(const Jet2d& x, const Jet2d& y) {
  const Jet2d dx = x - Jet2d::constant(0.6);
  const Jet2d dy = y - Jet2d::constant(0.8);
  return Jet2d::constant(1) + sine(x * 3.0 + Jet2d::constant(1)) * cosine(y * 2.0) * 0.6 +
         decay((dx * dx + dy * dy) * 12.5);
}

/// The scheme that method.md section 8.3 calls fixed, of which it gives the errors; without the silhouettes'
/// terms.
Settings fixed_settings(int32_t samples, double march_step) {
  Settings settings = plain_settings(Order::multiple, samples);
  settings.mean_rule = settings.subtract = settings.obliquity = true;
  settings.march_step = march_step;
  return settings;
}

Settings all_corrections(int32_t samples, double march_step) {
  Settings settings = fixed_settings(samples, march_step);
  settings.bisections = 8;
  settings.sliding = true;
  return settings;
}

std::vector<Vec2d> points_of_all_zones(int n) {
  std::vector<Vec2d> points;
  for (const Zone zone : {Zone::lit, Zone::penumbra, Zone::umbra}) {
    const std::vector<Vec2d> some = box_points(zone, n);
    points.insert(points.end(), some.begin(), some.end());
  }
  return points;
}

/// Errors of a march in the box, all zones together.
Errors errors_of(const Source& source, const Settings& settings, int n) {
  const Scene scene(box_scene(2, 0.8));
  const ScatteredRadiance reference(scene, source);
  return measure(
      points_of_all_zones(n),
      [&](const Vec2d& x) { return estimate_medium_aware(scene, source, settings, x).mean; },
      [&](const Vec2d& x) { return reference.at(x); });
}

/// Worst relative difference to finite differences over the points where these agree with themselves at half
/// the step (Richardson's check): on creases of the answer, and where it changes its cells, they don't.
Errors worst_against_differences(const Source& source, const std::vector<Vec2d>& points, double step,
                                 double agreement) {
  const Scene scene(box_scene(2, 0.8));
  const ScatteredRadiance reference(scene, source);
  Errors worst;
  size_t compared = 0;
  for (const Vec2d& x : points) {
    const auto value = [&](const Vec2d& y) { return reference.at(y).value; };
    const Jet2d coarse = finite_differences(value, x, 2 * step);
    const Jet2d fine = finite_differences(value, x, step);
    const Jet2d exact = reference.at(x);
    if ((coarse.hessian - fine.hessian).norm() > agreement * exact.hessian.norm()) continue;
    ++compared;
    worst.gradient =
        std::max(worst.gradient, glm::length(exact.gradient - fine.gradient) / glm::length(exact.gradient));
    worst.hessian = std::max(worst.hessian, (exact.hessian - fine.hessian).norm() / exact.hessian.norm());
  }
  EXPECT_GE(3 * compared, 2 * points.size());
  return worst;
}

TEST(FlatlandQuadrature, DerivativesAreThoseOfFiniteDifferences) {
  const Errors worst = worst_against_differences(SmoothSource(hill), points_of_all_zones(6), 2e-3, 1e-3);
  EXPECT_LT(worst.gradient, 2e-5);
  EXPECT_LT(worst.hessian, 1e-3);
}

TEST(FlatlandQuadrature, CreasesOfTheSourceAreNoObstacle) {
  // Penumbra, umbra, lit.
  const Scene scene(box_scene(2, 0.8));
  const Errors worst = worst_against_differences(DirectRadianceSource(scene),
                                                 {{0.63, 0.31}, {0.27, 0.31}, {0.83, 0.72}}, 8e-3, 1e-2);
  EXPECT_LT(worst.gradient, 1e-3);
  EXPECT_LT(worst.hessian, 1e-2);
}

TEST(FlatlandQuadrature, ThickUniformMediumGivesItsClosedForm) {
  // Walls are 40 mean free paths away: as if there were none. M = q0 sigma_s / sigma_t, no derivatives (I12).
  SceneDescription description;
  description.box_min = {-1, -1};
  description.sigma_t = 40;
  description.albedo = 0.75;
  const Scene scene(description);
  const SmoothSource source(uniform);
  const Jet2d exact = ScatteredRadiance(scene, source).at({0, 0});
  EXPECT_NEAR(exact.value, 1.5 * 0.75, 1e-12);
  EXPECT_NEAR(glm::length(exact.gradient), 0, 1e-11);
  EXPECT_NEAR(exact.hessian.norm(), 0, 1e-9);
}

TEST(FlatlandMarch, UniformMediumGivesZeroDerivativesToRounding) {
  SceneDescription description;
  description.box_min = {-1, -1};
  description.sigma_t = 40;
  description.albedo = 0.75;
  const Scene scene(description);
  const SmoothSource source(uniform);
  const Jet2d fixed = estimate_medium_aware(scene, source, fixed_settings(256, 0.005), {0, 0}).mean;
  EXPECT_NEAR(fixed.value, 1.5 * 0.75, 1e-12);
  EXPECT_NEAR(glm::length(fixed.gradient), 0, 1e-11);
  EXPECT_NEAR(fixed.hessian.norm(), 0, 1e-9);
  // What the subtraction is for: the plain scheme's Hessian diverges with the step (method.md section 8.2).
  Settings plain = plain_settings(Order::multiple, 256);
  plain.march_step = 0.005;
  EXPECT_GT(estimate_medium_aware(scene, source, plain, {0, 0}).mean.hessian.norm(), 100);
}

TEST(FlatlandMarch, LinearSourceGivesItsSlope) {
  // In an infinite medium M = sigma_s / sigma_t q, hence grad M = sigma_s / sigma_t grad q (I13), no Hessian.
  SceneDescription description;
  description.box_min = {-1, -1};
  description.sigma_t = 40;
  description.albedo = 0.75;
  const Scene scene(description);
  const SmoothSource source(slope);
  const Jet2d jet = estimate_medium_aware(scene, source, fixed_settings(256, 0.0025), {0, 0}).mean;
  EXPECT_NEAR(jet.gradient.x, 0.75 * 0.7, 2e-3);
  EXPECT_NEAR(jet.gradient.y, 0.75 * 0.4, 2e-3);
  EXPECT_LT(jet.hessian.norm(), 0.02 * glm::length(jet.gradient) * description.sigma_t);
}

TEST(FlatlandMarch, MomentsAreTheSumOverShells) {
  // The definition of method.md section 8.1, shell by shell and segment by segment.
  const Scene scene(box_scene(2, 0.8));
  const SmoothSource source(hill);
  Settings settings = plain_settings(Order::multiple, 64);
  settings.march_step = 0.05;
  const Vec2d x(0.63, 0.31);
  const Ring ring = make_ring(scene, x, settings.samples, 0, settings.seed);
  Jet2d expected;
  for (int shell = 0; shell < 30; ++shell) {  // 1.5 long, more than the diagonal
    const double s = (shell + 0.5) * settings.march_step;
    for (size_t i = 0; i < ring.sights.size(); ++i) {
      const Sight* ends[] = {&ring.sights[i], &ring.after(i)};
      std::vector<const Sight*> alive;
      for (const Sight* end : ends) {
        if (s < end->hit.distance) alive.push_back(end);
      }
      const auto vertex = [s](const Sight& end) { return end.direction * std::min(s, end.hit.distance); };
      const Jet2d factor = form_factor(vertex(*ends[0]), vertex(*ends[1]));
      for (const Sight* end : alive) {
        const Vec2d r = end->direction * s;
        expected +=
            transmittance_jet(2.0, distance_jet<double, 2>(r)) * factor *
            (scene.sigma_s() * source.value(x + r) * settings.march_step / static_cast<double>(alive.size()));
      }
    }
  }
  const Jet2d found = estimate_medium_aware(scene, source, settings, x).mean;
  EXPECT_NEAR(found.value, expected.value, 1e-13);
  EXPECT_NEAR(glm::length(found.gradient - expected.gradient), 0, 1e-12);
  EXPECT_NEAR((found.hessian - expected.hessian).norm(), 0, 1e-10);
}

TEST(FlatlandMarch, GradientsConverge) {
  const SmoothSource source(hill);
  EXPECT_LE(errors_of(source, fixed_settings(256, 0.025), 12).gradient, 0.03);
  const Errors errors = errors_of(source, fixed_settings(1024, 0.0125), 12);
  EXPECT_LE(errors.gradient, 0.007);
  EXPECT_LE(errors.median_angle, 0.5);
}

TEST(FlatlandMarch, HessianOfThePlainSchemeIsWrongTheFixedOneIsNot) {
  const SmoothSource source(hill);
  Settings plain = plain_settings(Order::multiple, 1024);
  plain.march_step = 0.0125;
  const double wrong = errors_of(source, plain, 12).hessian;
  EXPECT_GT(wrong, 2.0);
  EXPECT_LT(wrong, 3.5);
  EXPECT_LE(errors_of(source, fixed_settings(1024, 0.0125), 12).hessian, 0.07);
  // Its remainder are the silhouettes, whose far side slides through the medium and ends at a sliding point.
  EXPECT_LE(errors_of(source, all_corrections(256, 0.025), 12).hessian, 0.01);
}

TEST(FlatlandMarch, SlidingTermIsWhatTheUmbraNeeds) {
  const Scene scene(box_scene(2, 0.8));
  const DirectRadianceSource source(scene);
  const ScatteredRadiance reference(scene, source);
  const std::vector<Vec2d> points = box_points(Zone::umbra, 8);
  const auto error = [&](const Settings& settings) {
    return measure(
               points, [&](const Vec2d& x) { return estimate_medium_aware(scene, source, settings, x).mean; },
               [&](const Vec2d& x) { return reference.at(x); })
        .hessian;
  };
  EXPECT_GT(error(fixed_settings(256, 0.025)), 0.25);
  EXPECT_LT(error(all_corrections(256, 0.025)), 0.15);
}

TEST(FlatlandModel, AddsSingleAndMultipleScattering) {
  const Vec2d x(0.63, 0.31);
  for (const Method method : {Method::exact, Method::unaware, Method::aware}) {
    Jet2d sum;
    Settings settings;
    settings.method = method;
    settings.samples = 64;
    for (const Order order : {Order::single, Order::multiple}) {
      settings.order = order;
      sum += Model(box_scene(2, 0.8), settings).estimate(x).mean;
    }
    settings.order = Order::both;
    const Jet2d both = Model(box_scene(2, 0.8), settings).estimate(x).mean;
    EXPECT_EQ(both.value, sum.value);
    EXPECT_EQ(both.gradient, sum.gradient);
  }
}

TEST(FlatlandModel, WithoutScatteringThereIsNoMultipleScattering) {
  Settings settings;
  settings.order = Order::multiple;
  for (const Method method : {Method::exact, Method::unaware, Method::aware}) {
    settings.method = method;
    EXPECT_EQ(Model(box_scene(2, 0), settings).estimate({0.6, 0.3}).mean.value, 0);
  }
}

TEST(FlatlandModel, ExtremeMediaGiveFiniteNumbers) {
  for (const double sigma_t : {0.0, 1e3, largest_number}) {
    for (const Method method : {Method::exact, Method::unaware, Method::aware}) {
      Settings settings;
      settings.method = method;
      settings.samples = 16;
      const Model model(box_scene(sigma_t, 1), settings);
      for (const Vec2d& x : {Vec2d(0.63, 0.31), Vec2d(0.4, 0.95 - 3e-9)}) {
        const Jet2d jet = model.estimate(x).mean;
        EXPECT_TRUE(std::isfinite(jet.value) && std::isfinite(glm::length(jet.gradient)) &&
                    std::isfinite(jet.hessian.norm()))
            << static_cast<int>(method) << " at " << x.x << ", " << x.y << ", sigma_t " << sigma_t;
      }
    }
  }
}

TEST(FlatlandModel, ExactMultipleScatteringHasALimit) {
  SceneDescription description = box_scene();
  for (int i = 0; i < 3; ++i)
    description.segments.push_back({{0.6 + 0.1 * i, 0.2}, {0.63 + 0.1 * i, 0.33 + 0.02 * i}, 0});
  Settings settings;
  settings.method = Method::exact;
  try {
    const Model model(description, settings);
    ADD_FAILURE();
  } catch (const Error& error) {
    EXPECT_EQ(error.reason(), "TOO_MANY_CREASES");
  }
}

}  // namespace
}  // namespace fogbank::derivatives::flatland
