#include "core/sobol.h"

#include <gtest/gtest.h>

#include <cmath>
#include <set>
#include <vector>

#include "core/random.h"

namespace fogbank {
namespace {

std::vector<float> values_of(uint32_t first, uint32_t count, uint32_t dimension, uint32_t scramble) {
  std::vector<float> values(count);
  scrambled_sobol(first, dimension, scramble, values);
  return values;
}

TEST(Sobol, OneValueInEachInterval) {
  for (const uint32_t scramble : {0u, 1u, 0x9E3779B9u})
    for (uint32_t dimension = 0; dimension < sobol_dimensions; ++dimension)
      for (const uint32_t count : {1u, 4u, 16u, 64u})
        for (const uint32_t block : {0u, 1u, 5u, 1000u}) {
          std::set<int> intervals;
          for (const float value : values_of(block * count, count, dimension, scramble)) {
            EXPECT_GE(value, 0.0f);
            EXPECT_LT(value, 1.0f);
            intervals.insert(static_cast<int>(value * static_cast<float>(count)));
          }
          EXPECT_EQ(intervals.size(), count) << dimension << ' ' << block;
        }
}

TEST(Sobol, FirstTwoDimensionsFillEveryElementaryBox) {
  // The (0, 2)-sequence in base 2 of Sobol' 1967: 2^6 points have one in each box of area 2^-6.
  const std::vector<float> x = values_of(128, 64, 0, 17);
  const std::vector<float> y = values_of(128, 64, 1, 42);
  for (int bits = 0; bits <= 6; ++bits) {
    std::set<int> boxes;
    for (size_t i = 0; i < x.size(); ++i) {
      const auto column = static_cast<int>(std::ldexp(x[i], bits));
      const auto row = static_cast<int>(std::ldexp(y[i], 6 - bits));
      boxes.insert((row << bits) + column);
    }
    EXPECT_EQ(boxes.size(), 64u) << bits;
  }
}

TEST(Sobol, SinglePointsAreThoseOfTheSequence) {
  for (uint32_t dimension = 0; dimension < sobol_dimensions; ++dimension) {
    const std::vector<float> values = values_of(7, 40, dimension, 99);
    for (uint32_t i = 0; i < 40; ++i) EXPECT_EQ(scrambled_sobol(7 + i, dimension, 99), values[i]);
  }
}

TEST(Sobol, IntegralsOfSmoothFunctionsConvergeFasterThanRandomOnes) {
  // Over random scrambles the mean is the integral, and the variance falls below that of independent points,
  // which is var(f) / n: var(x y z) = 1/27 - 1/64.
  constexpr int trials = 400;
  constexpr uint32_t points = 64;
  double sum = 0;
  double squares = 0;
  for (uint32_t trial = 0; trial < trials; ++trial) {
    RandomStream random(3, 1, 2, trial);
    std::vector<float> values[3];
    for (uint32_t d = 0; d < 3; ++d) values[d] = values_of(0, points, d, random.next_uint());
    double mean = 0;
    for (size_t i = 0; i < points; ++i)
      mean += static_cast<double>(values[0][i]) * static_cast<double>(values[1][i]) *
              static_cast<double>(values[2][i]);
    mean /= points;
    sum += mean;
    squares += (mean - 0.125) * (mean - 0.125);
  }
  const double variance = squares / trials;
  EXPECT_LT(variance, 0.1 * (1.0 / 27 - 1.0 / 64) / points);
  // 5 standard errors.
  EXPECT_NEAR(sum / trials, 0.125, 5 * std::sqrt(variance / trials));
}

TEST(RandomStream, SharedBitsAreThoseOfThePixel) {
  RandomStream first(1, 5, 6, 0);
  RandomStream second(1, 5, 6, 77);
  RandomStream elsewhere(1, 5, 7, 0);
  EXPECT_EQ(second.sample(), 77u);
  const auto bits = first.next_shared();
  EXPECT_EQ(bits, second.next_shared());
  EXPECT_NE(bits, elsewhere.next_shared());
  // Another set at the next position, and no trace of it in the sample's own numbers.
  EXPECT_NE(bits, first.next_shared());
  EXPECT_NE(first.next_uint(), second.next_uint());
}

}  // namespace
}  // namespace fogbank
