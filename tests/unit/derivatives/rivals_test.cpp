// The two methods that the occlusion-aware one is measured against: finite differences (the reference, so it
// is itself held against closed forms) and the occlusion-unaware kernels.
#include <gtest/gtest.h>

#include <algorithm>
#include <memory>

#include "core/random.h"
#include "derivatives/estimator.h"
#include "derivatives/penumbra_reference.h"
#include "derivatives/text_scene.h"
#include "derivatives/transmittance_jet.h"
#include "derivatives/triangle_form_factor.h"
#include "scene/loader.h"

namespace fogbank::derivatives {
namespace {

using transport::World;

std::shared_ptr<const World> load(const std::string& root, const std::string& file) {
  scene::prepare_render_thread();
  return std::make_shared<const World>(scene::load_scene(file, scene::folder_source(root), {}));
}

std::shared_ptr<const World> parse(const std::string& sigma_t, const std::string& body) {
  return test::world_in_fog(sigma_t, "0.5", body);
}

EstimatorSettings direct_only(int32_t samples, int32_t repeats) {
  EstimatorSettings settings;
  settings.order = Order::single;
  settings.max_depth = 2;
  settings.samples = samples;
  settings.repeats = repeats;
  return settings;
}

PointEstimate estimate(const std::shared_ptr<const World>& world, const char* method,
                       const EstimatorSettings& settings, const Vec3d& x) {
  return average(*make_estimator(method, world, settings), settings, Vec3f(x));
}

double relative_gradient_error(const Jet3d& found, const Jet3d& expected) {
  return glm::length(found.gradient - expected.gradient) / glm::length(expected.gradient);
}
double relative_hessian_error(const Jet3d& found, const Jet3d& expected) {
  return (found.hessian - expected.hessian).norm() / expected.hessian.norm();
}

/// Form factor of the ceiling light as two triangles, signed so that it is positive from below.
Jet3d ceiling_form_factor(const Vec3d& x) {
  const Vec3d a = Vec3d(-1, -1, 2) - x;
  const Vec3d b = Vec3d(1, -1, 2) - x;
  const Vec3d c = Vec3d(1, 1, 2) - x;
  const Vec3d d = Vec3d(-1, 1, 2) - x;
  Jet3d sum = triangle_form_factor_jet(RelativeTriangle<double>::from_relative(a, b, c)) +
              triangle_form_factor_jet(RelativeTriangle<double>::from_relative(a, c, d));
  return sum.value < 0 ? sum * -1.0 : sum;
}

/// Differences lose 1e-7 (single-precision rays don't matter here, but steps are only 1e-2 of the scene) to
/// truncation in the gradient, and about as much relative to the step squared in the Hessian.
TEST(FiniteDifference, UnoccludedRectangleWithoutExtinction) {
  const auto world = parse("0", test::ceiling_light);
  for (const Vec3d x : {Vec3d(0, 0, 0), Vec3d(0.5, -0.3, 1), Vec3d(2, 1, -1), Vec3d(-0.9, 0.9, 1.7)}) {
    const PointEstimate found = estimate(world, "finite-difference", direct_only(16, 2), x);
    const Jet3d expected = ceiling_form_factor(Vec3d(Vec3f(x)));
    for (size_t c = 0; c < 3; ++c) {
      const Jet3d scaled = expected * static_cast<double>(c + 1);
      EXPECT_NEAR(found.mean.channels[c].value, scaled.value, 1e-8 * scaled.value);
      EXPECT_LT(relative_gradient_error(found.mean.channels[c], scaled), 1e-5) << x.x;
      EXPECT_LT(relative_hessian_error(found.mean.channels[c], scaled), 1e-3) << x.x;
    }
  }
}

/// F = (1 - cos of the half angle) / 2 for a sphere; on the axis of a disk the same.
TEST(FiniteDifference, SphereAndDisk) {
  const auto sphere = parse("0", R"(<shape type="sphere"><float name="radius" value="0.5"/>
      <emitter type="area"><rgb name="radiance" value="1"/></emitter></shape>)");
  const Vec3d x(1, 0.5, -0.25);
  const Jet3d d2 = distance_jet(-x) * distance_jet(-x);
  const Jet3d inside = Jet3d::constant(1) - chain(d2, 0.25 / d2.value, -0.25 / (d2.value * d2.value),
                                                  0.5 / (d2.value * d2.value * d2.value));
  const double root = std::sqrt(inside.value);
  const Jet3d expected =
      0.5 * (Jet3d::constant(1) - chain(inside, root, 0.5 / root, -0.25 / (root * inside.value)));
  const Jet3d found = estimate(sphere, "finite-difference", direct_only(16, 1), x).mean.channels[0];
  EXPECT_NEAR(found.value, expected.value, 1e-8);
  EXPECT_LT(relative_gradient_error(found, expected), 1e-5);
  EXPECT_LT(relative_hessian_error(found, expected), 1e-3);

  const auto disk = parse(
      "0", R"(<shape type="disk"><emitter type="area"><rgb name="radiance" value="1"/></emitter></shape>)");
  const Jet3d on_axis = estimate(disk, "finite-difference", direct_only(16, 1), {0, 0, 1}).mean.channels[0];
  EXPECT_NEAR(on_axis.value, 0.5 * (1 - std::sqrt(0.5)), 1e-8);
  // d/dz of z / sqrt(z^2 + 1)
  EXPECT_NEAR(on_axis.gradient.z, -0.5 * std::pow(2.0, -1.5), 1e-5);
}

/// Method.md section 7, the unblocked closed form of a point light.
TEST(FiniteDifference, PointLight) {
  const auto world = parse("0.7", R"(<emitter type="point"><rgb name="intensity" value="4"/></emitter>)");
  const Vec3d x(0.5, 1, -0.5);
  const Jet3d d = distance_jet(-x);
  const double i = 1 / d.value;
  const Jet3d expected = 4.0 * static_cast<double>(inv_4pi) *
                         transmittance_jet(static_cast<double>(0.7f), d) *
                         chain(d, i * i, -2 * i * i * i, 6 * i * i * i * i);
  const Jet3d found = estimate(world, "finite-difference", direct_only(16, 1), x).mean.channels[0];
  EXPECT_NEAR(found.value, expected.value, 1e-6 * expected.value);
  EXPECT_LT(relative_gradient_error(found, expected), 1e-4);
  EXPECT_LT(relative_hessian_error(found, expected), 1e-2);
  const Jet3d rival = estimate(world, "unaware", direct_only(16, 1), x).mean.channels[0];
  EXPECT_LT(relative_gradient_error(rival, expected), 1e-5);
  EXPECT_LT(relative_hessian_error(rival, expected), 1e-5);
}

/// Points all over the penumbra scene, compared with what is left of the light by inclusion and exclusion.
class PenumbraScene : public testing::Test {
 protected:
  struct Point {
    Vec3d x;
    Jet3d expected;
    double share;
  };

  void SetUp() override {
    world_ = load("scenes/penumbra", "penumbra.xml");
    const auto reference = test::PenumbraReference::of_scene(static_cast<double>(0.3f));
    RandomStream random(3, 0, 0, 0);
    while (points_.size() < 16) {
      const Vec3d x(Vec3f(-2 + 4 * random.next_float(), -1.5f + 3 * random.next_float(),
                          -0.9f + 1.8f * random.next_float()));
      bool reliable = false;
      const Jet3d expected = reference.jet(x, reliable);
      const double share = reference.visible_share(x);
      if (reliable && share > 0.02) points_.push_back({x, expected, share});
    }
  }

  /// Channel 0, radiance 1 instead of 26.
  Jet3d found(const char* method, const EstimatorSettings& settings, const Vec3d& x) const {
    return estimate(world_, method, settings, x).mean.channels[0] * (1.0 / 26);
  }

  std::shared_ptr<const World> world_;
  std::vector<Point> points_;
};

double median(std::vector<double> values) {
  std::nth_element(values.begin(), values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2),
                   values.end());
  return values[values.size() / 2];
}

/// Rays in single precision place silhouettes to some 1e-7 of the light, which the Hessian shows divided by
/// the square of the step; a step that a kink nearby forces down costs two more digits.
TEST_F(PenumbraScene, FiniteDifferencesAreAReference) {
  std::vector<double> hessian;
  for (const Point& point : points_) {
    if (hessian.size() == 7) break;
    const Jet3d jet = found("finite-difference", direct_only(16, 1), point.x);
    EXPECT_NEAR(jet.value, point.expected.value, 1e-5 * point.expected.value);
    EXPECT_LT(relative_gradient_error(jet, point.expected), 1e-3);
    hessian.push_back(relative_hessian_error(jet, point.expected));
  }
  EXPECT_LT(*std::max_element(hessian.begin(), hessian.end()), 0.1);
  EXPECT_LT(median(hessian), 0.01);
}

/// Method.md section 7, table: 60 degrees and 84 % of the gradient's length, whatever the number of rays.
TEST_F(PenumbraScene, UnawareIsRightInTheOpenAndWrongInThePenumbra) {
  std::vector<double> lit;
  std::vector<double> penumbra;
  std::vector<double> angles;
  for (const Point& point : points_) {
    const Jet3d jet = found("unaware", direct_only(16384, 4), point.x);
    const double error = relative_gradient_error(jet, point.expected);
    if (point.share == 1) lit.push_back(error);
    if (point.share > 0.95) continue;
    penumbra.push_back(error);
    const double cosine = glm::dot(glm::normalize(jet.gradient), glm::normalize(point.expected.gradient));
    angles.push_back(glm::degrees(std::acos(std::clamp(cosine, -1.0, 1.0))));
  }
  ASSERT_GE(lit.size(), 5u);
  ASSERT_GE(penumbra.size(), 5u);
  EXPECT_LT(median(lit), 1e-3);
  EXPECT_GT(median(penumbra), 0.6);
  EXPECT_GT(median(angles), 40);
  EXPECT_LT(median(angles), 80);
}

/// In a closed surrounding of radiance 1 without any loss the mean radiance is 1 everywhere, by whichever way
/// light comes: every derivative is 0, up to noise.
TEST(Rivals, FurnaceIsFlat) {
  const auto world = load("scenes/analytic", "furnace_medium.xml");
  EstimatorSettings settings;
  settings.samples = 16;
  settings.repeats = 6;
  for (const char* method : {"finite-difference", "unaware"}) {
    const PointEstimate found = estimate(world, method, settings, {0.1, -0.2, 0.05});
    SCOPED_TRACE(method);
    EXPECT_NEAR(found.mean.channels[0].value, 1, 5 * found.standard_error.channels[0].value + 0.02);
    for (int i = 0; i < 3; ++i)
      EXPECT_NEAR(found.mean.channels[0].gradient[i], 0,
                  5 * found.standard_error.channels[0].gradient[i] + 1e-6);
  }
}

}  // namespace
}  // namespace fogbank::derivatives
