#include "transport/phase_function.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>

#include "core/frame.h"
#include "core/random.h"
#include "core/sampling.h"
#include "support/statistics.h"

namespace fogbank::transport {
namespace {

constexpr double pi_double = 3.14159265358979323846;

/// |g| from isotropic over the neighbourhood of 0, where the usual formulas divide by it, to nearly a Dirac.
const float mean_cosines[] = {0.0f,  1e-7f, -1e-4f, 9e-4f, 0.05f,  -0.3f,   0.5f,
                              -0.7f, 0.85f, -0.95f, 0.99f, 0.999f, -0.9999f};

/// Henyey-Greenstein in double precision, straight from the paper.
double henyey_greenstein(double g, double cosine) {
  return (1 - g * g) / (4 * pi_double * std::pow(1 + g * g - 2 * g * cosine, 1.5));
}

/// Share of the phase function's light with a cosine below `cosine` (its integral in closed form).
double share_below(double g, double cosine) {
  if (std::fabs(g) < 1e-3) return 0.5 * (1 + cosine) + 0.75 * g * (cosine * cosine - 1);  // to order g^2
  return (1 - g * g) / (2 * g) * (1 / std::sqrt(1 + g * g - 2 * g * cosine) - 1 / (1 + g));
}

TEST(PhaseFunction, AgreesWithTheClosedForm) {
  const Vec3f incoming = glm::normalize(Vec3f(0.3f, -0.5f, 0.8f));
  const Frame frame = Frame::from_normal(incoming);
  for (const float g : mean_cosines)
    for (int i = -50; i <= 50; ++i) {
      const double angle = pi_double * (i + 50) / 100.0;
      const Vec3f outgoing =
          frame.to_world({static_cast<float>(std::sin(angle)), 0, static_cast<float>(std::cos(angle))});
      const double expected = henyey_greenstein(g, std::cos(angle));
      // A chord of length sin(angle) with an error of 1e-7 against the lobe's width of 1 - |g|.
      const double tolerance = 2e-5 + 6e-7 / (1 - std::fabs(g));
      EXPECT_NEAR(PhaseFunction(g).evaluate(incoming, outgoing) / expected, 1.0, tolerance)
          << "g " << g << " angle " << angle;
    }
}

TEST(PhaseFunction, ForwardForPositiveMeanCosine) {
  const Vec3f w(0, 0, 1);
  EXPECT_GT(PhaseFunction(0.5f).evaluate(w, w), PhaseFunction(0.5f).evaluate(w, -w));
  EXPECT_LT(PhaseFunction(-0.5f).evaluate(w, w), PhaseFunction(-0.5f).evaluate(w, -w));
}

TEST(PhaseFunction, SamplesFollowTheClosedForm) {
  constexpr int count = 100000;
  constexpr int rows = 40;
  constexpr int columns = 8;
  const Vec3f incoming = glm::normalize(Vec3f(-0.6f, 0.2f, -0.3f));
  const Frame frame = Frame::from_normal(incoming);
  for (const float g : mean_cosines) {
    std::vector<double> observed(rows * columns);
    std::vector<double> expected(rows * columns);
    // Rows of equal probability, so that a narrow lobe fills all of them.
    std::vector<double> edges(rows + 1, -1.0);
    for (int row = 1; row <= rows; ++row) {
      double low = -1;
      double high = 1;
      for (int i = 0; i < 60; ++i) {
        const double middle = 0.5 * (low + high);
        (share_below(g, middle) < static_cast<double>(row) / rows ? low : high) = middle;
      }
      edges[static_cast<size_t>(row)] = high;
    }
    RandomStream random(1, 2, 3, 4);
    double sum_of_cosines = 0;
    for (int i = 0; i < count; ++i) {
      const PhaseSample sample = PhaseFunction(g).sample(incoming, random.next_vec2());
      ASSERT_NEAR(glm::length(sample.direction), 1.0f, 1e-6f);
      EXPECT_NEAR(sample.pdf / PhaseFunction(g).pdf(incoming, sample.direction), 1.0,
                  1e-4 + 6e-7 / (1 - std::fabs(g)));
      const Vec3d local(glm::dot(Vec3d(sample.direction), Vec3d(frame.tangent)),
                        glm::dot(Vec3d(sample.direction), Vec3d(frame.bitangent)),
                        glm::dot(Vec3d(sample.direction), Vec3d(frame.normal)));
      sum_of_cosines += local.z;
      const auto edge = std::upper_bound(edges.begin() + 1, edges.end() - 1, local.z);
      const auto row = static_cast<size_t>(edge - edges.begin() - 1);
      const double turn = std::atan2(local.y, local.x) / (2 * pi_double) + 0.5;
      const auto column = std::min(static_cast<size_t>(turn * columns), size_t{columns - 1});
      observed[row * columns + column] += 1;
    }
    for (size_t row = 0; row < rows; ++row)
      for (size_t column = 0; column < columns; ++column)
        expected[row * columns + column] =
            count * (share_below(g, edges[row + 1]) - share_below(g, edges[row])) / columns;
    // In rows narrower than 1e-6 in the cosine, floats choose the row; those lobes are left to the mean
    // cosine.
    if (std::fabs(g) < 0.995f) {
      EXPECT_GT(test::chi_squared_test(observed, expected),
                1.0 - std::pow(0.99, 1.0 / std::size(mean_cosines)))
          << g;
    }
    // Variance of the cosine is at most 1/3: four standard errors.
    EXPECT_NEAR(sum_of_cosines / count, g, 4 * std::sqrt(1.0 / 3 / count)) << g;
  }
}

TEST(PhaseFunction, ExtremeRandomNumbersStayFinite) {
  for (const float g : mean_cosines)
    for (const float x : {0.0f, one_minus_epsilon})
      for (const float y : {0.0f, one_minus_epsilon}) {
        const PhaseSample sample = PhaseFunction(g).sample({0, 0, -1}, {x, y});
        EXPECT_TRUE(is_finite(sample.direction)) << g;
        EXPECT_TRUE(std::isfinite(sample.pdf) && sample.pdf > 0) << g;
      }
}

scene::ObjectPointer phase(const std::string& type, std::vector<scene::Property> properties = {}) {
  return std::make_shared<scene::ObjectDescription>(scene::ObjectDescription{
      "phase", type, "", {"fog.xml", 7, "<phase type=\"" + type + "\">"}, std::move(properties)});
}

TEST(BuildPhaseFunction, ReadsItsParameters) {
  EXPECT_TRUE(build_phase_function(nullptr).is_isotropic());
  EXPECT_TRUE(build_phase_function(phase("isotropic")).is_isotropic());
  EXPECT_FLOAT_EQ(build_phase_function(phase("hg")).mean_cosine(), 0.8f);
  EXPECT_FLOAT_EQ(build_phase_function(phase("hg", {{"g", -0.25, {}}})).mean_cosine(), -0.25f);
}

TEST(BuildPhaseFunction, RefusesWhatItDoesNotKnow) {
  const auto expect_refused = [](const scene::ObjectPointer& description, const std::string& reason,
                                 const std::string& message) {
    try {
      build_phase_function(description);
      FAIL() << description->type;
    } catch (const SceneError& error) {
      EXPECT_EQ(error.reason(), reason);
      EXPECT_THAT(error.what(),
                  testing::HasSubstr("fog.xml:7: <phase type=\"" + description->type + "\">: "));
      EXPECT_THAT(error.what(), testing::HasSubstr(message));
    }
  };
  expect_refused(phase("rayleigh"), "UNKNOWN_PHASE_FUNCTION",
                 "'rayleigh' is not a phase function Fogbank knows; supported: hg, isotropic");
  expect_refused(phase("hg", {{"g", 1.0, {}}}), "OUT_OF_RANGE", "'g'");
  expect_refused(phase("hg", {{"g", -1.5, {}}}), "OUT_OF_RANGE", "'g'");
  expect_refused(phase("hg", {{"g", std::numeric_limits<double>::quiet_NaN(), {}}}), "NOT_FINITE", "'g'");
  expect_refused(phase("isotropic", {{"g", 0.5, {}}}), "UNKNOWN_PARAMETER", "'g'");
}

TEST(BuildPhaseFunction, LenientLoadingPutsIsotropicInItsPlace) {
  std::vector<std::string> warnings;
  EXPECT_TRUE(build_phase_function(phase("rayleigh"), &warnings).is_isotropic());
  ASSERT_EQ(warnings.size(), 1u);
  EXPECT_THAT(warnings[0], testing::HasSubstr("isotropic stands in"));
}

}  // namespace
}  // namespace fogbank::transport
