#include "derivatives/medium_march.h"

#include <gtest/gtest.h>

#include "derivatives/medium_reference.h"
#include "derivatives/transmittance_jet.h"

namespace fogbank::derivatives {
namespace {

const std::vector<Vec3d> extinctions{
    Vec3d(1), Vec3d(0), Vec3d(1e-9), Vec3d(1e6), Vec3d(0.01, 1, 100), Vec3d(0, 0, 3), Vec3d(1e-2, 1, 1e2)};

void expect_strata(const std::vector<double>& ends, double extent) {
  ASSERT_FALSE(ends.empty());
  double begin = 0;
  for (const double end : ends) {
    EXPECT_GT(end, begin);
    begin = end;
  }
  EXPECT_EQ(ends.back(), extent);
}

TEST(MarchingStrata, CoverTheWayInShortSteps) {
  for (const Vec3d& sigma_t : extinctions) {
    for (const double extent : {1e-3, 1.0, 7.3, 1e4}) {
      const std::vector<double> ends = marching_strata(sigma_t, extent, 0.25, 32);
      expect_strata(ends, extent);
      // 9.21 mean free paths of each channel, and the extent in 32.
      EXPECT_LE(ends.size(), 3 * 37 + 34u);
      double begin = 0;
      for (const double end : ends) {
        for (int c = 0; c < 3; ++c) {
          if (sigma_t[c] * begin < 9.2) {
            EXPECT_LE((end - begin) * sigma_t[c], 0.25 * (1 + 1e-8));
          }
        }
        begin = end;
      }
    }
  }
}

TEST(ImportanceStrata, ShareOutTransmittance) {
  const std::vector<double> ends = importance_strata(Vec3d(2), 1e4, 0, 4);
  expect_strata(ends, 1e4);
  ASSERT_EQ(ends.size(), 4u);
  for (int k = 1; k < 4; ++k) EXPECT_NEAR(std::exp(-2 * ends[static_cast<size_t>(k - 1)]), 1 - k / 4.0, 1e-6);
}

TEST(ImportanceStrata, BeginSmallAndGrow) {
  const std::vector<double> ends = importance_strata(Vec3d(0), 1, 0.01, 4);
  expect_strata(ends, 1);
  const double first[] = {0.01, 0.03, 0.09};
  for (size_t k = 0; k < 3; ++k) EXPECT_NEAR(ends[k], first[k], 1e-12);
  for (const Vec3d& sigma_t : extinctions) {
    for (const double extent : {1e-3, 1.0, 1e4}) {
      for (const double share : {0.0, 1e-4, 0.125, 1.0}) {
        const std::vector<double> strata = importance_strata(sigma_t, extent, share * extent, 5);
        expect_strata(strata, extent);
        EXPECT_LE(strata.size(), 16u);
      }
    }
  }
}

/// The mean over `u` of a function times `inverse_pdf` is its integral: what makes values unbiased.
TEST(SampleStratum, IsUnbiased) {
  const test::Quadrature rule(40);
  for (const Vec3d& sigma_t : {Vec3d(1), Vec3d(0), Vec3d(1e-9), Vec3d(0.1, 1, 10), Vec3d(0, 2, 2)}) {
    const double begin = 0.3;
    const double end = 2.1;
    for (int c = 0; c < 3; ++c) {
      const auto light = [&](double s) { return std::exp(-sigma_t[c] * s) * (1 + s * s); };
      // Midpoint rule: error 1/n^2 times what the last bit of u does where it reaches far into the dark.
      constexpr int n = 100000;
      double mean = 0;
      for (int i = 0; i < n; ++i) {
        const DistanceSample sample = sample_stratum(sigma_t, begin, end, (i + 0.5) / n);
        EXPECT_GE(sample.distance, begin);
        EXPECT_LE(sample.distance, end);
        mean += light(sample.distance) * sample.inverse_pdf / n;
      }
      EXPECT_NEAR(mean, rule.integrate(begin, end, light), 1e-4);
    }
  }
}

TEST(SampleStratum, WeighsAGreyMediumExactly) {
  for (const double u : {0.0, 0.3, 0.999999}) {
    const DistanceSample sample = sample_stratum(Vec3d(2), 1, 3, u);
    EXPECT_NEAR(std::exp(-2 * sample.distance) * sample.inverse_pdf, (std::exp(-2.0) - std::exp(-6.0)) / 2,
                1e-15);
  }
}

TEST(NearIntegrals, AreThoseOfPowersTimesTransmittance) {
  for (const double depth : {0.0, 1e-6, 0.25, 1.0}) {
    const double length = 0.5;
    const double sigma_t = depth / length;
    const test::Quadrature rule(20);
    const NearIntegrals integrals = near_integrals(sigma_t, length);
    const auto power = [&](int n) {
      return rule.integrate(0, length, [&](double s) { return std::pow(s, n) * std::exp(-sigma_t * s); });
    };
    EXPECT_NEAR(integrals.order0, power(0), 1e-7 * power(0));
    EXPECT_NEAR(integrals.order1, power(1), 1e-7 * power(1));
    EXPECT_NEAR(integrals.order2, power(2), 1e-7 * power(2));
  }
}

}  // namespace
}  // namespace fogbank::derivatives
