#include "support/statistics.h"

#include <gtest/gtest.h>

namespace fogbank::test {
namespace {

TEST(ChiSquared, MatchesPublishedQuantiles) {
  // Upper quantiles from the usual tables (e.g. Abramowitz and Stegun, table 26.8), to the digits printed
  // there.
  EXPECT_NEAR(chi_squared_p_value(3.84146, 1), 0.05, 1e-6);
  EXPECT_NEAR(chi_squared_p_value(18.3070, 10), 0.05, 1e-6);
  EXPECT_NEAR(chi_squared_p_value(15.9872, 10), 0.10, 1e-6);
  EXPECT_NEAR(chi_squared_p_value(135.807, 100), 0.01, 1e-6);
  EXPECT_NEAR(chi_squared_p_value(0.0, 5), 1.0, 0.0);
}

TEST(ChiSquared, SeesABiasedDie) {
  const std::vector<double> expected(6, 1000.0);
  EXPECT_GT(chi_squared_test({1010, 985, 1003, 992, 1020, 990}, expected), 0.5);
  EXPECT_LT(chi_squared_test({1200, 960, 960, 960, 960, 960}, expected), 1e-6);
}

TEST(ChiSquared, PoolsRareBinsAndRefusesImpossibleOnes) {
  EXPECT_GT(chi_squared_test({1, 0, 2, 1, 996}, {1, 1, 1, 1, 996}), 0.1);
  EXPECT_EQ(chi_squared_test({1, 999}, {0, 1000}), 0.0);
}

TEST(SignificanceLevel, SharesOnePercentAmongAllTests) {
  EXPECT_NEAR(significance_level(1), 0.01, 1e-15);
  EXPECT_NEAR(std::pow(1 - significance_level(20), 20), 0.99, 1e-12);
}

}  // namespace
}  // namespace fogbank::test
