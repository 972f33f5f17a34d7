// The batch against one triangle at a time in double precision with the product rule of jets; its closed sums
// against invariants I1 and I2 of method.md section 12; the arctangent against the C library's.
#include "derivatives/form_factor_batch.h"

#include <gtest/gtest.h>

#include <bit>

#include "derivatives/closed_surroundings.h"
#include "derivatives/transmittance_jet.h"
#include "derivatives/triangle_form_factor.h"

namespace fogbank::derivatives {
namespace {

using test::closed_surroundings;
using test::Surroundings;
using test::uniform;

template <typename Real>
struct Batch {
  std::vector<BatchVertex<Real>> vertices;
  std::vector<BatchTriangle> triangles;
  std::vector<Spectrum> weights;

  Batch(const Surroundings& surroundings, RandomStream& random) {
    for (size_t i = 0; i < surroundings.directions.size(); ++i) {
      vertices.emplace_back(glm::vec<3, Real>(surroundings.directions[i]),
                            static_cast<Real>(1 / surroundings.distances[i]));
      weights.emplace_back(random.next_float(), random.next_float(), random.next_float());
    }
    for (const auto& corners : surroundings.triangles)
      triangles.push_back({corners, 1 + random.next_uint() % BatchTriangle::all});
  }
  /// The vertex that the batch has after rounding, relative to the point.
  Vec3d position(uint32_t i) const {
    return Vec3d(vertices[i].direction()) / static_cast<double>(vertices[i].inverse_distance());
  }
};

/// What the batch is to sum up, and the sum of the absolute values, by which errors are measured: a sum can't
/// be expected to be more accurate than its terms.
struct Reference {
  RadianceJet sum;
  std::array<std::array<double, 3>, 3> magnitude{};  ///< [channel][value, gradient, Hessian]
};

template <typename Real>
Reference reference(const Batch<Real>& batch, const Spectrum& sigma_t) {
  Reference result;
  for (const BatchTriangle& triangle : batch.triangles) {
    const auto& [a, b, c] = triangle.vertices;
    const auto relative =
        RelativeTriangle<double>::from_relative(batch.position(a), batch.position(b), batch.position(c));
    const Jet3d form_factor = triangle_form_factor_edges(relative, scaled_vertices(relative));
    for (size_t corner = 0; corner < 3; ++corner) {
      if ((triangle.receivers >> corner & 1) == 0) continue;
      const uint32_t vertex = triangle.vertices[corner];
      const Jet3d distance = distance_jet(batch.position(vertex));
      for (size_t channel = 0; channel < 3; ++channel) {
        const int c_int = static_cast<int>(channel);
        const double sigma = static_cast<double>(sigma_t[c_int]);
        // Transmittance relative to that at the point: the weight holds the rest.
        const Jet3d transmittance = chain(distance, 1.0, -sigma, sigma * sigma);
        const double weight =
            static_cast<double>(batch.weights[vertex][c_int]) / std::popcount(triangle.receivers);
        const Jet3d term = transmittance * form_factor * weight;
        result.sum.channels[channel] += term;
        result.magnitude[channel][0] += std::abs(term.value);
        result.magnitude[channel][1] += glm::length(term.gradient);
        result.magnitude[channel][2] += term.hessian.norm();
      }
    }
  }
  return result;
}

template <typename Real>
class FormFactorBatch : public testing::Test {};
using Reals = testing::Types<float, double>;
TYPED_TEST_SUITE(FormFactorBatch, Reals);

TYPED_TEST(FormFactorBatch, EqualsTrianglesOneByOne) {
  using Real = TypeParam;
  // Triangles a quarter radian wide lose 4 ulp in gradients and 16 in Hessians (method.md section 4.3) of
  // roundings that number a dozen; measured 8 and 11 ulp.
  constexpr double tolerance = 40 * static_cast<double>(std::numeric_limits<Real>::epsilon());
  for (uint32_t configuration = 0; configuration < 300; ++configuration) {
    RandomStream random(1, configuration, 0, 0);
    // 18 vertices and 32 triangles, or 66 and 128: with and without an incomplete register at the end.
    const Batch<Real> batch(
        closed_surroundings(random, 1 + static_cast<int>(configuration % 2), 0.2, 0.5, 50), random);
    const Spectrum sigma_t(0.0f, 0.1f, 2.0f);
    const Reference expected = reference(batch, sigma_t);
    for (const DerivativeOrder order :
         {DerivativeOrder::value, DerivativeOrder::gradient, DerivativeOrder::hessian}) {
      const auto form_factors = gather_form_factors<Real>(batch.vertices, batch.triangles, order);
      const RadianceJet found =
          gather_radiance<Real>(batch.vertices, form_factors, batch.weights, sigma_t, order);
      for (size_t channel = 0; channel < 3; ++channel) {
        const Jet3d& jet = found.channels[channel];
        const Jet3d& truth = expected.sum.channels[channel];
        const auto& magnitude = expected.magnitude[channel];
        EXPECT_NEAR(jet.value, truth.value, tolerance * magnitude[0]);
        if (order == DerivativeOrder::value)
          EXPECT_EQ(glm::length(jet.gradient), 0);
        else
          EXPECT_LE(glm::length(jet.gradient - truth.gradient), tolerance * magnitude[1]);
        if (order != DerivativeOrder::hessian)
          EXPECT_EQ(jet.hessian.norm(), 0);
        else
          EXPECT_LE((jet.hessian - truth.hessian).norm(), tolerance * magnitude[2]);
      }
    }
  }
}

TYPED_TEST(FormFactorBatch, ClosedSurroundingsOfEqualRadianceHaveNoDerivatives) {
  using Real = TypeParam;
  // I1 and I2. Edge terms cancel to the bit, so what is left is the adding up.
  constexpr double tolerance = 8 * static_cast<double>(std::numeric_limits<Real>::epsilon());
  for (uint32_t configuration = 0; configuration < 10000; ++configuration) {
    RandomStream random(2, configuration, 0, 0);
    const Batch<Real> batch(closed_surroundings(random, 1, 0.4, 1e-2, 1e2), random);
    const auto form_factors =
        gather_form_factors<Real>(batch.vertices, batch.triangles, DerivativeOrder::hessian);
    Jet3d sum;
    Jet3d magnitude;
    for (const auto& form_factor : form_factors) {
      const Jet<Real, 3> jet = form_factor.jet();
      const Jet3d term{jet.value, Vec3d(jet.gradient), {}};
      sum += term;
      for (size_t i = 0; i < 6; ++i) sum.hessian.entries[i] += static_cast<double>(jet.hessian.entries[i]);
      magnitude.value += std::abs(term.value);
      magnitude.gradient.x += glm::length(term.gradient);
      magnitude.hessian.entries[0] += static_cast<double>(jet.hessian.norm());
    }
    ASSERT_NEAR(sum.value, 1, tolerance * magnitude.value);
    ASSERT_LE(glm::length(sum.gradient), tolerance * magnitude.gradient.x);
    ASSERT_LE(sum.hessian.norm(), tolerance * magnitude.hessian.entries[0]);
  }
}

TYPED_TEST(FormFactorBatch, VerticesAtInfinityHaveNoParallax) {
  using Real = TypeParam;
  RandomStream random(3, 0, 0, 0);
  Batch<Real> batch(closed_surroundings(random, 1, 0.1, 1, 2), random);
  for (auto& vertex : batch.vertices) vertex = {vertex.direction(), 0};
  const auto form_factors =
      gather_form_factors<Real>(batch.vertices, batch.triangles, DerivativeOrder::hessian);
  for (const auto& form_factor : form_factors) {
    EXPECT_EQ(glm::length(form_factor.jet().gradient), 0);
    EXPECT_EQ(form_factor.jet().hessian.norm(), 0);
  }
}

template <typename Real>
class Arctangent : public testing::Test {};
TYPED_TEST_SUITE(Arctangent, Reals);

TYPED_TEST(Arctangent, IsWithinThreeUlp) {
  using Real = TypeParam;
  constexpr size_t lanes = simd_lanes<Real>;
  RandomStream random(4, 0, 0, 0);
  double worst = 0;
  for (int i = 0; i < 100000; ++i) {
    Simd<Real> y{};
    Simd<Real> x{};
    for (size_t lane = 0; lane < lanes; ++lane) {
      // Quotients over 30 decades, and close to the bounds of the reduction.
      const double ratio = (i & 1) != 0 ? std::pow(10, uniform(random, -15, 15))
                                        : std::tan(M_PI / 8 * (1 + static_cast<double>(i % 3))) *
                                              uniform(random, 0.999, 1.001);
      x[lane] = static_cast<Real>(uniform(random, -1, 1));
      y[lane] = static_cast<Real>(ratio * uniform(random, -1, 1));
    }
    const Simd<Real> angle = arctangent<Real>(y, x);
    for (size_t lane = 0; lane < lanes; ++lane) {
      const long double truth =
          std::atan2(static_cast<long double>(y[lane]), static_cast<long double>(x[lane]));
      const Real rounded = static_cast<Real>(std::abs(truth));
      const Real ulp = std::nextafter(rounded, std::numeric_limits<Real>::infinity()) - rounded;
      worst = std::max(worst, static_cast<double>(std::abs(static_cast<long double>(angle[lane]) - truth)) /
                                  static_cast<double>(ulp));
    }
  }
  EXPECT_LE(worst, 3);

  this->RecordProperty("worst_ulp", std::to_string(worst));
}

TYPED_TEST(Arctangent, AxesAndOriginAreExact) {
  using Real = TypeParam;
  const Real pi_real = static_cast<Real>(M_PIl);
  const auto at = [](Real y, Real x) { return arctangent<Real>(Simd<Real>{} + y, Simd<Real>{} + x)[0]; };
  EXPECT_EQ(at(0, 0), 0);
  EXPECT_EQ(at(0, 1), 0);
  EXPECT_EQ(at(0, -1), pi_real);
  EXPECT_EQ(at(1, 0), pi_real / 2);
  EXPECT_EQ(at(-1, 0), -pi_real / 2);
  EXPECT_EQ(at(1, 1), pi_real / 4);
  EXPECT_EQ(at(-1, -1), static_cast<Real>(-0.75L * M_PIl));
}

}  // namespace
}  // namespace fogbank::derivatives
