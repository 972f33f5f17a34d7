// Fresnel's equations and the microfacet distributions against closed forms and quadrature.
#include "transport/microfacet.h"

#include <gtest/gtest.h>

#include <complex>

#include "transport/fresnel.h"
#include "transport/rough_interface.h"

namespace fogbank::transport {
namespace {

constexpr double pi_double = 3.14159265358979323846;

TEST(Fresnel, DielectricAtNormalIncidence) {
  for (const float eta : {0.5f, 1.0003f, 1.5f, 2.4f}) {
    const double expected = std::pow((eta - 1.0) / (eta + 1.0), 2);
    EXPECT_NEAR(fresnel_dielectric(1.0f, eta).reflectance, expected, 1e-6);
    EXPECT_NEAR(fresnel_dielectric(-1.0f, eta).reflectance, expected, 1e-6);
    EXPECT_NEAR(fresnel_conductor(1.0f, eta, 0.0f), expected, 1e-6);
  }
}

TEST(Fresnel, BrewsterTotalReflectionAndSnell) {
  const float eta = 1.5f;
  const float brewster = std::cos(std::atan(eta));
  // At Brewster's angle only the perpendicular polarisation is reflected: ((eta^2 - 1) / (eta^2 + 1))^2 / 2.
  EXPECT_NEAR(fresnel_dielectric(brewster, eta).reflectance, 0.5 * std::pow(1.25 / 3.25, 2), 1e-6);
  const float critical = std::sqrt(1 - 1 / (eta * eta));
  EXPECT_EQ(fresnel_dielectric(-critical * 0.99f, eta).reflectance, 1.0f);
  EXPECT_LT(fresnel_dielectric(-critical * 1.01f, eta).reflectance, 1.0f);
  const DielectricFresnel fresnel = fresnel_dielectric(0.6f, eta);
  EXPECT_NEAR(0.8 / std::sqrt(1 - sqr(fresnel.cos_theta_t)), eta, 1e-5);
  EXPECT_LT(fresnel.cos_theta_t, 0);
  const Vec3f w(0.8f, 0, 0.6f);
  const Vec3f refracted = refract(w, {0, 0, 1}, fresnel.cos_theta_t, fresnel.eta_ti);
  EXPECT_NEAR(glm::length(refracted), 1.0f, 1e-6f);
  EXPECT_NEAR(refracted.x, -0.8f / eta, 1e-6f);
}

TEST(Fresnel, ConductorAgreesWithComplexArithmetic) {
  for (const double eta : {0.0, 0.2, 1.0, 3.0})
    for (const double k : {0.1, 2.0, 7.0})
      for (const double cosine : {1.0, 0.7, 0.2, 0.01}) {
        const std::complex<double> index(eta, k);
        const std::complex<double> inner = std::sqrt(index * index - (1 - cosine * cosine));
        const double perpendicular = std::norm((cosine - inner) / (cosine + inner));
        const double parallel =
            std::norm((index * index * cosine - inner) / (index * index * cosine + inner));
        EXPECT_NEAR(
            fresnel_conductor(static_cast<float>(cosine), static_cast<float>(eta), static_cast<float>(k)),
            0.5 * (perpendicular + parallel), 2e-5)
            << eta << " " << k << " " << cosine;
      }
}

TEST(Fresnel, DiffuseReflectanceAgreesWithQuadrature) {
  for (const double eta : {0.1, 0.3, 0.55, 0.67, 0.8, 1.1, 1.33, 1.5, 2.0, 5.0}) {
    constexpr int count = 20000;
    double sum = 0;
    for (int i = 0; i < count; ++i) {
      const double cosine = (i + 0.5) / count;
      sum += 2 * cosine *
             fresnel_dielectric(static_cast<float>(cosine), static_cast<float>(eta)).reflectance / count;
    }
    // As the header promises; near 1 the reflectance itself is small and only its absolute error matters.
    EXPECT_NEAR(fresnel_diffuse_reflectance(static_cast<float>(eta)), sum, 6e-3 * sum + 1e-3) << eta;
  }
}

TEST(InverseErf, InvertsErf) {
  for (int i = -999; i <= 999; ++i) {
    const float x = static_cast<float>(i) / 1000;
    EXPECT_NEAR(std::erf(inverse_erf(x)), x, 3e-7f);
  }
}

/// Midpoint rule over the hemisphere in (theta, azimuth).
template <typename Function>
double integrate_hemisphere(const Function& function) {
  constexpr int steps = 600;
  double sum = 0;
  for (int i = 0; i < steps; ++i)
    for (int j = 0; j < steps; ++j) {
      const double theta = (i + 0.5) / steps * pi_double / 2;
      const double azimuth = (j + 0.5) / steps * pi_double * 2;
      const Vec3f m(static_cast<float>(std::sin(theta) * std::cos(azimuth)),
                    static_cast<float>(std::sin(theta) * std::sin(azimuth)),
                    static_cast<float>(std::cos(theta)));
      sum += function(m) * std::sin(theta);
    }
  return sum * (pi_double / 2 / steps) * (2 * pi_double / steps);
}

class Microfacets : public testing::TestWithParam<std::tuple<MicrofacetType, float, float>> {
 protected:
  MicrofacetDistribution facets() const {
    const auto& [type, alpha_u, alpha_v] = GetParam();
    return {type, alpha_u, alpha_v};
  }
};

// Facets cover the surface once, seen from above (Heitz 2014, eq. 4) and from any other side (eq. 17). The
// tolerances are those of the quadrature.
TEST_P(Microfacets, AreNormalised) {
  EXPECT_NEAR(integrate_hemisphere([&](const Vec3f& m) { return double{facets().density(m)} * m.z; }), 1.0,
              2e-3);
  for (const float z : {1.0f, 0.8f, 0.3f, 0.05f}) {
    const Vec3f v(std::sqrt(1 - z * z) * 0.6f, std::sqrt(1 - z * z) * -0.8f, z);
    EXPECT_NEAR(
        integrate_hemisphere([&](const Vec3f& m) { return double{facets().visible_normal_pdf(v, m)}; }), 1.0,
        2e-3)
        << z;
    // With the masking that is evaluated: exact for GGX, within the fit's 0.35 % for Beckmann.
    EXPECT_NEAR(integrate_hemisphere([&](const Vec3f& m) {
                  return double{facets().density(m)} * facets().masking_over_cosine(v, m) *
                         std::fmax(0.0f, glm::dot(v, m));
                }),
                1.0, 5.5e-3)
        << z;
  }
}

TEST_P(Microfacets, MaskingIsAShareAndHidesBacks) {
  for (const float z : {1.0f, 0.5f, 1e-3f, 0.0f, -0.4f}) {
    const Vec3f v(std::sqrt(1 - z * z), 0, z);
    const Vec3f m = glm::normalize(Vec3f(0.3f, 0.1f, 0.8f));
    const float masking = facets().masking(v, m);
    EXPECT_GE(masking, 0.0f);
    EXPECT_LE(masking, 1.0f);
    if (glm::dot(v, m) * z <= 0) {
      EXPECT_EQ(masking, 0.0f);
    }
  }
}

INSTANTIATE_TEST_SUITE_P(All, Microfacets,
                         testing::Combine(testing::Values(MicrofacetType::beckmann, MicrofacetType::ggx),
                                          testing::Values(0.1f, 0.4f, 1.0f), testing::Values(0.1f, 0.7f)));

// Nearly flat facets: the smooth interface's Fresnel transmittance and diffuse reflectance.
TEST(RoughInterface, TendsToTheSmoothOne) {
  const float eta = 1.5f;
  for (const MicrofacetType type : {MicrofacetType::beckmann, MicrofacetType::ggx}) {
    const RoughInterface coat(type, 1e-3f, eta);
    // The table's linear interpolation bends the steep end at grazing angles; beyond 0.1 it is good to 0.3 %.
    for (const float cosine : {0.1f, 0.4f, 0.7f, 1.0f})
      EXPECT_NEAR(coat.transmittance(cosine), 1 - fresnel_dielectric(cosine, eta).reflectance, 3e-3)
          << cosine;
    // Its mean over the nodes falls short by half of the last node's term of 64: 2 * 0.04 / 128, and by 1
    // / 64.
    EXPECT_NEAR(coat.internal_reflectance() * 64.0 / 63.0, fresnel_diffuse_reflectance(1 / eta), 5e-3);
  }
}

}  // namespace
}  // namespace fogbank::transport
