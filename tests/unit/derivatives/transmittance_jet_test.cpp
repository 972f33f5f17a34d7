// Invariants I4 (its part with a medium), I9 and I15 of method.md section 12.
#include "derivatives/transmittance_jet.h"

#include <gtest/gtest.h>

#include "derivatives/closed_surroundings.h"
#include "derivatives/triangle_form_factor.h"

namespace fogbank::derivatives {
namespace {

using test::uniform;
using test::uniform_direction;

constexpr uint32_t configurations = 10000;

template <typename Real>
class Transmittance : public testing::Test {
 public:
  static constexpr Real epsilon = std::numeric_limits<Real>::epsilon();
};
using Reals = testing::Types<float, double>;
TYPED_TEST_SUITE(Transmittance, Reals);

template <typename Real, int Dim>
glm::vec<Dim, Real> random_vertex(RandomStream& random) {
  return glm::vec<Dim, Real>(uniform_direction(random) * std::pow(10, uniform(random, -6, 6)));
}

TYPED_TEST(Transmittance, I9TraceOfTheHessian) {
  using Real = TypeParam;
  for (uint32_t i = 0; i < configurations; ++i) {
    RandomStream random(9, i, 0, 0);
    const auto check = [&](const auto& distance, int dimensions) {
      const Real sigma_t = static_cast<Real>(std::pow(10, uniform(random, -9, 1))) / distance.value;
      const Real pull = static_cast<Real>(dimensions - 1) * sigma_t / distance.value;
      const auto jet = transmittance_jet(sigma_t, distance);
      // 1e-14 in double, and as many roundings in float.
      ASSERT_NEAR(jet.hessian.trace(), jet.value * (sigma_t * sigma_t - pull),
                  45 * this->epsilon * jet.value * (sigma_t * sigma_t + pull));
    };
    check(distance_jet(random_vertex<Real, 3>(random)), 3);
    check(distance_jet(random_vertex<Real, 2>(random)), 2);
  }
}

TYPED_TEST(Transmittance, I15IntegralTendsToTheDistance) {
  using Real = TypeParam;
  for (uint32_t i = 0; i < configurations; ++i) {
    RandomStream random(15, i, 0, 0);
    const auto distance = distance_jet(random_vertex<Real, 3>(random));
    const Real depth = static_cast<Real>(std::pow(10, uniform(random, -30, -1)));
    const auto jet = transmittance_integral_jet(depth / distance.value, distance);
    // E = d (1 - depth/2 + ...) and its derivatives those of d, times the transmittance 1 - depth + ....
    const Real tolerance = depth + 8 * this->epsilon;
    ASSERT_NEAR(jet.value, distance.value, tolerance * distance.value);
    ASSERT_LE(glm::length(jet.gradient - distance.gradient), tolerance);
    ASSERT_LE((jet.hessian - distance.hessian).norm(), 3 * tolerance * distance.hessian.norm());
    const auto vacuum = transmittance_integral_jet(Real(0), distance);
    ASSERT_EQ(vacuum.value, distance.value);
    ASSERT_EQ(vacuum.gradient, distance.gradient);
    ASSERT_EQ(transmittance_jet(Real(0), distance).value, 1);
    ASSERT_EQ(glm::length(transmittance_jet(Real(0), distance).gradient), 0);
  }
}

TYPED_TEST(Transmittance, I15UnderflowIsExactlyNothing) {
  using Real = TypeParam;
  // Its reciprocal is a normal number: threads that trace flush others to zero.
  constexpr Real largest = std::numeric_limits<Real>::max() / 8;
  for (uint32_t i = 0; i < configurations; ++i) {
    RandomStream random(16, i, 0, 0);
    const auto distance = distance_jet(random_vertex<Real, 3>(random));
    const bool is_extreme = (i & 1) != 0;
    const Real depth = static_cast<Real>(is_extreme ? 1 : std::pow(10, uniform(random, 3, 6)));
    const Real sigma_t = is_extreme ? largest : depth / distance.value;
    const auto jet = transmittance_jet(sigma_t, distance);
    ASSERT_EQ(jet.value, 0);
    ASSERT_EQ(glm::length(jet.gradient), 0);
    ASSERT_EQ(jet.hessian.norm(), 0);
    const auto integral = transmittance_integral_jet(sigma_t, distance);
    ASSERT_NEAR(integral.value * sigma_t, 1, 2 * this->epsilon);
    ASSERT_EQ(glm::length(integral.gradient), 0);
  }
}

TYPED_TEST(Transmittance, PointOnTheVertexHasNoDerivatives) {
  using Real = TypeParam;
  const auto distance = distance_jet(glm::vec<3, Real>(0));
  for (const Real sigma_t : {Real(0), Real(1), std::numeric_limits<Real>::max()}) {
    EXPECT_EQ(transmittance_jet(sigma_t, distance).value, 1);
    EXPECT_EQ(transmittance_jet(sigma_t, distance).hessian.norm(), 0);
    EXPECT_EQ(transmittance_integral_jet(sigma_t, distance).value, 0);
  }
}

// I15: d M / d sigma_t of a triangle's contribution T F equals -d T F, for value, gradient and Hessian; of E
// it is (d T - E)/sigma_t.
TEST(TransmittanceDerivatives, I15ConsistentWithTheExtinction) {
  for (uint32_t i = 0; i < configurations; ++i) {
    RandomStream random(17, i, 0, 0);
    const Vec3d r1 = 3.0 * uniform_direction(random);
    const Vec3d r2 = 4.0 * uniform_direction(random);
    const Vec3d r3 = 5.0 * uniform_direction(random);
    const Jet3d form_factor = triangle_form_factor_jet(RelativeTriangle<double>::from_relative(r1, r2, r3));
    const Jet3d distance = distance_jet(r3);
    const double sigma_t = uniform(random, 0.1, 1);
    const double step = 1e-5;
    const auto radiance = [&](double sigma) { return transmittance_jet(sigma, distance) * form_factor; };
    const Jet3d difference = (radiance(sigma_t + step) + radiance(sigma_t - step) * -1.0) * (0.5 / step);
    const Jet3d expected = distance * radiance(sigma_t) * -1.0;
    // Central differences: (step d)^2 / 6 relative, and rounding of 1e-16 / step.
    const double tolerance = 1e-8;
    ASSERT_NEAR(difference.value, expected.value, tolerance);
    ASSERT_LE(glm::length(difference.gradient - expected.gradient),
              tolerance * (1 + glm::length(form_factor.gradient)));
    ASSERT_LE((difference.hessian - expected.hessian).norm(), tolerance * (1 + form_factor.hessian.norm()));
    const double integral_difference = (transmittance_integral(sigma_t + step, distance.value) -
                                        transmittance_integral(sigma_t - step, distance.value)) *
                                       (0.5 / step);
    const double integral_expected = (distance.value * transmittance(sigma_t, distance.value) -
                                      transmittance_integral(sigma_t, distance.value)) /
                                     sigma_t;
    ASSERT_NEAR(integral_difference, integral_expected, 10 * tolerance);
  }
}

// I4: lengths times s with sigma_t over s divide gradient and Hessian by s and s^2; exact for powers of two.
TYPED_TEST(Transmittance, I4ScaleWithTheMedium) {
  using Real = TypeParam;
  for (uint32_t i = 0; i < configurations; ++i) {
    RandomStream random(18, i, 0, 0);
    const auto vertex = random_vertex<Real, 3>(random);
    const Real sigma_t = static_cast<Real>(uniform(random, 0.1, 3)) / glm::length(vertex);
    const int exponent = static_cast<int>(random.next_uint() % 40) - 20;
    const Real scale = std::ldexp(Real(1), exponent);
    const auto jet = transmittance_jet(sigma_t, distance_jet(vertex));
    const auto scaled = transmittance_jet(sigma_t / scale, distance_jet(vertex * scale));
    ASSERT_EQ(scaled.value, jet.value);
    ASSERT_EQ(scaled.gradient * scale, jet.gradient);
    ASSERT_EQ((scaled.hessian * (scale * scale)).entries, jet.hessian.entries);
  }
}

}  // namespace
}  // namespace fogbank::derivatives
