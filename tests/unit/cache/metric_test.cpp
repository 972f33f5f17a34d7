#include "cache/metric.h"

#include <gmock/gmock.h>

#include <algorithm>
#include <fstream>
#include <nlohmann/json.hpp>

#include "core/error.h"
#include "record_clouds.h"

namespace fogbank::cache {
namespace {

template <int Dim>
void expect_vector(const nlohmann::json& entry) {
  std::array<double, static_cast<size_t>(Dim)> eigenvalues{};
  std::array<double, static_cast<size_t>(Dim)> caps{};
  for (size_t i = 0; i < Dim; ++i) {
    eigenvalues[i] = entry.at("eigenvalues").at(i);
    caps[i] = entry.at("caps").at(i);
    if (caps[i] == 0) caps[i] = 1e30;
  }
  const double budget = entry.at("budget");
  const auto axes = level_set_semi_axes<Dim>(eigenvalues, budget, caps, entry.at("maximum_anisotropy"));
  // Logarithms of numbers up to e^30 and their exponential: some 30 roundings.
  for (size_t i = 0; i < Dim; ++i) {
    const double expected = entry.at("semi_axes").at(i);
    EXPECT_NEAR(axes[i] / expected, 1, 2e-14) << entry;
  }
  const double radius = entry.at("ball_radius");
  EXPECT_NEAR(ball_radius<Dim>(eigenvalues, budget) / radius, 1, 1e-15 * 8) << entry;
}

TEST(SemiAxes, AgreeWithQuadratureAndBisection) {
  std::ifstream file("tests/numerics/vectors/radii.json");
  int count = 0;
  const nlohmann::json vectors = nlohmann::json::parse(file);
  for (const nlohmann::json& entry : vectors.at("cases")) {
    ++count;
    if (entry.at("eigenvalues").size() == 2)
      expect_vector<2>(entry);
    else
      expect_vector<3>(entry);
  }
  EXPECT_GT(count, 16);
}

TEST(SemiAxes, MeetTheBudgetOrTheCaps) {
  RandomStream random(1, 0, 0, 0);
  const auto power = [&](double range) {
    return std::pow(10, range * (2 * static_cast<double>(random.next_float()) - 1));
  };
  for (int i = 0; i < 5000; ++i) {
    const double scale = power(25);
    std::array<double, 3> eigenvalues{scale * power(5), -scale * power(5), scale * power(5)};
    const double budget = power(20);
    const double radius = ball_radius<3>(eigenvalues, budget);
    const std::array<double, 3> caps{radius * power(2), radius * power(2), radius * power(2)};
    const double anisotropy = 1 + 9 * static_cast<double>(random.next_float());
    const std::array<double, 3> axes = level_set_semi_axes<3>(eigenvalues, budget, caps, anisotropy);
    const double largest =
        std::fabs(*std::max_element(eigenvalues.begin(), eigenvalues.end(),
                                    [](double a, double b) { return std::fabs(a) < std::fabs(b); }));
    for (double& eigenvalue : eigenvalues)
      eigenvalue = std::max(std::fabs(eigenvalue), largest / (anisotropy * anisotropy));
    if (axes == caps)
      EXPECT_LE(error_integral<3>(eigenvalues, axes), budget);
    else
      EXPECT_NEAR(error_integral<3>(eigenvalues, axes) / budget, 1, 1e-11);
  }
}

TEST(SemiAxes, ScaleAsTheFifthRootOfTheThreshold) {
  const std::array<double, 3> eigenvalues{3, -1, 0.5};
  const std::array<double, 3> caps{1e9, 1e9, 1e9};
  const auto one = level_set_semi_axes<3>(eigenvalues, 1e-3, caps, 10);
  const auto other = level_set_semi_axes<3>(eigenvalues, 32e-3, caps, 10);
  for (size_t i = 0; i < 3; ++i) EXPECT_NEAR(other[i] / one[i], 2, 1e-13);
}

MetricSettings settings() {
  MetricSettings result;
  result.threshold = 1e-3;
  result.radiance_floor = 0.01;
  result.maximum_radius = 10;
  return result;
}

Place place(float radiance, const Vec3f& gradient) {
  Place result;
  result.radiance = Spectrum(radiance);
  result.gradient.fill(gradient);
  result.hessian(0, 0) = 1;
  result.hessian(1, 1) = 2;
  result.hessian(2, 2) = -3;
  result.visibility_margin = infinity;
  return result;
}

TEST(BaseEllipsoid, FlatFieldsReachTheMaximumRadius) {
  Place flat = place(0, Vec3f(0));
  flat.hessian = {};
  for (const Shape shape : {Shape::ellipsoid, Shape::sphere}) {
    MetricSettings with = settings();
    with.shape = shape;
    for (const float a : base_ellipsoid(with, flat).semi_axes) EXPECT_EQ(a, 10.0f);
  }
}

TEST(BaseEllipsoid, SphereHasTheBallRadius) {
  MetricSettings with = settings();
  with.shape = Shape::sphere;
  const double expected = ball_radius<3>({1, 2, 3}, 1e-3);
  for (const float a : base_ellipsoid(with, place(1, Vec3f(0))).semi_axes)
    EXPECT_FLOAT_EQ(a, static_cast<float>(expected));
}

TEST(BaseEllipsoid, ExtrapolationStaysPositive) {
  const Place steep = place(1, {30, 0, 0});
  const Ellipsoid ellipsoid = base_ellipsoid(settings(), steep);
  for (size_t k = 0; k < 3; ++k)
    EXPECT_GE(1 - ellipsoid.semi_axes[k] * std::fabs(glm::dot(ellipsoid.axes[k], Vec3f(30, 0, 0))), -1e-6f);
  EXPECT_LE(ellipsoid.longest(), 3.0001f * ellipsoid.shortest());
}

TEST(BaseEllipsoid, VisibilityMarginBounds) {
  Place near = place(1, Vec3f(0));
  near.visibility_margin = 0.01f;
  EXPECT_EQ(base_ellipsoid(settings(), near).longest(), 0.01f);
  MetricSettings without = settings();
  without.guards.visibility_margin = false;
  EXPECT_GT(base_ellipsoid(without, near).longest(), 0.1f);
}

TEST(BaseEllipsoid, DarknessCountsAsTheFloor) {
  const Ellipsoid dark = base_ellipsoid(settings(), place(0, Vec3f(0)));
  const Ellipsoid at_floor = base_ellipsoid(settings(), place(0.01f, Vec3f(0)));
  EXPECT_EQ(dark.semi_axes, at_floor.semi_axes);
  EXPECT_LT(dark.longest(), base_ellipsoid(settings(), place(1, Vec3f(0))).longest());
  MetricSettings constant = settings();
  constant.reference = Reference::constant;
  EXPECT_EQ(base_ellipsoid(constant, place(1, Vec3f(0))).semi_axes, dark.semi_axes);
}

TEST(Ellipsoid, BoxAndShapeAgreeWithPointsOnIt) {
  RandomStream random(2, 0, 0, 0);
  for (int i = 0; i < 50; ++i) {
    Ellipsoid ellipsoid;
    ellipsoid.axes = test::random_frame(random);
    for (float& a : ellipsoid.semi_axes) a = 0.1f + random.next_float();
    const Vec3d box = ellipsoid.half_extents();
    Vec3d reached(0);
    for (int n = 0; n < 4000; ++n) {
      const Vec3f on_sphere = square_to_uniform_sphere(random.next_vec2());
      Vec3d offset(0);
      for (size_t k = 0; k < 3; ++k)
        offset += static_cast<double>(ellipsoid.semi_axes[k] * on_sphere[static_cast<int>(k)]) *
                  Vec3d(ellipsoid.axes[k]);
      EXPECT_NEAR(glm::length(ellipsoid.inverse_root() * offset), 1, 1e-5);
      reached = glm::max(reached, glm::abs(offset));
    }
    for (int axis = 0; axis < 3; ++axis) {
      EXPECT_LE(reached[axis], box[axis] * (1 + 1e-6));
      EXPECT_GE(reached[axis], box[axis] * 0.98);  // 4000 points leave gaps of some 0.05 rad
    }
  }
}

TEST(MinimumRadius, IsThatOfTheNearestFootprint) {
  MetricSettings with = settings();
  with.minimum_radius = 0.25;
  EXPECT_EQ(minimum_radius(with, Vec3f(0)), 0.25f);
  with.footprints = {{{3, 4, 0}, 0.1f}, {{0, 0, 20}, 0.1f}};
  with.minimum_pixels = 2;
  EXPECT_FLOAT_EQ(minimum_radius(with, Vec3f(0)), 1.0f);
  EXPECT_FLOAT_EQ(minimum_radius(with, {3, 4, 0.5f}), 0.25f);
}

TEST(ValidateMetric, NamesTheField) {
  EXPECT_NO_THROW(validate(settings()));
  const auto expect_refused = [](const std::string& field, auto change) {
    MetricSettings with = settings();
    change(with);
    try {
      validate(with);
      ADD_FAILURE() << "accepted a bad " << field;
    } catch (const Error& error) {
      EXPECT_EQ(error.reason(), "INVALID_SETTINGS");
      EXPECT_THAT(error.what(), testing::HasSubstr(field));
    }
  };
  const double nan = std::nan("");
  expect_refused("threshold", [](MetricSettings& s) { s.threshold = 0; });
  expect_refused("threshold", [&](MetricSettings& s) { s.threshold = nan; });
  expect_refused("radiance_floor", [](MetricSettings& s) { s.radiance_floor = 0; });
  expect_refused("maximum_anisotropy", [](MetricSettings& s) { s.maximum_anisotropy = 0.5; });
  expect_refused("maximum_radius", [](MetricSettings& s) { s.maximum_radius = INFINITY; });
  expect_refused("minimum_radius", [](MetricSettings& s) { s.minimum_radius = -1; });
  expect_refused("minimum_pixels", [&](MetricSettings& s) { s.minimum_pixels = nan; });
  expect_refused("footprints.camera", [](MetricSettings& s) { s.footprints = {{{infinity, 0, 0}, 1}}; });
  expect_refused("footprints.pixel_angle", [](MetricSettings& s) { s.footprints = {{{0, 0, 0}, -1}}; });
}

}  // namespace
}  // namespace fogbank::cache
