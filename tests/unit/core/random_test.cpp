#include "core/random.h"

#include <gtest/gtest.h>

#include <bit>
#include <set>
#include <tuple>
#include <vector>

#include "support/statistics.h"

namespace fogbank {
namespace {

using test::chi_squared_test;
using test::significance_level;

/// p-value of `count` numbers from `next` being uniform in [0, 1).
template <typename Next>
double uniformity(int count, Next next) {
  constexpr int bins = 256;
  std::vector<double> observed(bins, 0.0);
  for (int i = 0; i < count; ++i) observed[static_cast<std::size_t>(next() * float{bins})] += 1;
  return chi_squared_test(observed, std::vector<double>(bins, double(count) / bins));
}

/// p-value of pairs from `next` being uniform in the unit square.
template <typename Next>
double pair_uniformity(int count, Next next) {
  constexpr int bins = 32;
  std::vector<double> observed(bins * bins, 0.0);
  for (int i = 0; i < count; ++i) {
    const Vec2f pair = next();
    const auto column = static_cast<std::size_t>(pair.x * float{bins});
    const auto row = static_cast<std::size_t>(pair.y * float{bins});
    observed[row * bins + column] += 1;
  }
  return chi_squared_test(observed, std::vector<double>(bins * bins, double(count) / (bins * bins)));
}

constexpr int count = 1 << 18;

TEST(Philox, FlipsHalfOfAllBitsForAnyFlippedBit) {
  // Avalanche: each of the 128 output bits changes with probability 1/2. Over 192 input bits and 256 trials
  // the mean fraction has a standard deviation of 0.5 / sqrt(128 * 192 * 256) = 0.0002; 5 of them are
  // allowed. A single input bit has one of 0.5 / sqrt(128 * 256) = 0.0028; the largest of 192 stays below 5
  // of these.
  constexpr int trials = 256;
  double sum = 0;
  for (int bit = 0; bit < 192; ++bit) {
    double flipped = 0;
    for (uint32_t trial = 0; trial < trials; ++trial) {
      const std::array<uint32_t, 4> counter = {trial, trial * 7, 3, 4};
      const std::array<uint32_t, 2> key = {trial * 13, 6};
      auto changed_counter = counter;
      auto changed_key = key;
      const auto word = static_cast<std::size_t>(bit / 32);
      if (word < 4) {
        changed_counter[word] ^= 1u << (bit % 32);
      } else {
        changed_key[word - 4] ^= 1u << (bit % 32);
      }
      const auto a = philox4x32(counter, key);
      const auto b = philox4x32(changed_counter, changed_key);
      for (std::size_t i = 0; i < 4; ++i) flipped += std::popcount(a[i] ^ b[i]);
    }
    const double fraction = flipped / (128.0 * trials);
    EXPECT_NEAR(fraction, 0.5, 0.014) << "input bit " << bit;
    sum += fraction;
  }
  EXPECT_NEAR(sum / 192, 0.5, 0.001);
}

TEST(RandomStream, IsAPureFunctionOfItsArguments) {
  RandomStream first(1, 2, 3, 4, 5);
  RandomStream second(1, 2, 3, 4, 5);
  for (int i = 0; i < 1000; ++i) ASSERT_EQ(first.next_uint(), second.next_uint());
}

TEST(RandomStream, ACopyGoesOnWhereTheOriginalStood) {
  RandomStream original(1, 2, 3, 4);
  for (int i = 0; i < 7; ++i) original.next_uint();
  RandomStream copy = original;
  for (int i = 0; i < 100; ++i) ASSERT_EQ(original.next_uint(), copy.next_uint());
}

TEST(RandomStream, FloatsAreInTheHalfOpenUnitInterval) {
  RandomStream random(3, 0, 0, 0);
  for (int i = 0; i < 1000000; ++i) {
    const float u = random.next_float();
    ASSERT_GE(u, 0.0f);
    ASSERT_LT(u, 1.0f);
  }
}

TEST(RandomStream, NumbersOfOneStreamAreUniform) {
  RandomStream random(42, 17, 4, 0);
  EXPECT_GT(uniformity(count, [&] { return random.next_float(); }), significance_level(1));
  EXPECT_GT(pair_uniformity(count, [&] { return random.next_vec2(); }), significance_level(1));
}

TEST(RandomStream, FirstNumbersOfNeighboursAreUniform) {
  // What a renderer takes: the first few numbers of many streams that differ in one argument only. Each
  // argument walks alone through consecutive values.
  constexpr int tests = 5;
  const double level = significance_level(tests);
  uint32_t i = 0;
  EXPECT_GT(uniformity(count, [&] { return RandomStream(i++, 1, 2, 3, 4).next_float(); }), level) << "seed";
  i = 0;
  EXPECT_GT(uniformity(count, [&] { return RandomStream(9, i++, 2, 3, 4).next_float(); }), level)
      << "pixel x";
  i = 0;
  EXPECT_GT(uniformity(count, [&] { return RandomStream(9, 1, i++, 3, 4).next_float(); }), level)
      << "pixel y";
  i = 0;
  EXPECT_GT(uniformity(count, [&] { return RandomStream(9, 1, 2, i++, 4).next_float(); }), level) << "sample";
  i = 0;
  EXPECT_GT(uniformity(count, [&] { return RandomStream(9, 1, 2, 3, i++).next_float(); }), level) << "stream";
}

TEST(RandomStream, NeighboursAreIndependent) {
  // Pairs of the same position in two streams that differ by one in one argument.
  constexpr int tests = 5;
  const double level = significance_level(tests);
  const auto independence = [&](auto first, auto second) {
    uint32_t i = 0;
    return pair_uniformity(count, [&] {
      const Vec2f pair{first(i).next_float(), second(i).next_float()};
      ++i;
      return pair;
    });
  };
  const auto here = [](uint32_t i) { return RandomStream(9, i & 511, i >> 9, 0, 0); };
  EXPECT_GT(independence(here, [](uint32_t i) { return RandomStream(10, i & 511, i >> 9, 0, 0); }), level)
      << "seed";
  EXPECT_GT(independence(here, [](uint32_t i) { return RandomStream(9, (i & 511) + 1, i >> 9, 0, 0); }),
            level)
      << "pixel x";
  EXPECT_GT(independence(here, [](uint32_t i) { return RandomStream(9, i & 511, (i >> 9) + 1, 0, 0); }),
            level)
      << "pixel y";
  EXPECT_GT(independence(here, [](uint32_t i) { return RandomStream(9, i & 511, i >> 9, 1, 0); }), level)
      << "sample";
  EXPECT_GT(independence(here, [](uint32_t i) { return RandomStream(9, i & 511, i >> 9, 0, 1); }), level)
      << "stream";
}

TEST(RandomStream, StreamsNeverShareABlock) {
  // 64-bit prefixes of 2^16 streams x 4 numbers: a birthday collision among 2^17 of them has probability
  // 5e-10.
  std::set<std::tuple<uint32_t, uint32_t>> seen;
  for (uint32_t seed = 0; seed < 16; ++seed) {
    for (uint32_t stream = 0; stream < 16; ++stream) {
      for (uint32_t sample = 0; sample < 16; ++sample) {
        for (uint32_t pixel = 0; pixel < 16; ++pixel) {
          RandomStream random(seed, pixel, 5, sample, stream);
          for (int pair = 0; pair < 2; ++pair) {
            const uint32_t a = random.next_uint();
            const uint32_t b = random.next_uint();
            ASSERT_TRUE(seen.emplace(a, b).second);
          }
        }
      }
    }
  }
}

TEST(RandomStream, TheUpperHalfOfTheSeedCounts) {
  RandomStream low(1, 0, 0, 0);
  RandomStream high(1 | (uint64_t{1} << 32), 0, 0, 0);
  EXPECT_NE(low.next_uint(), high.next_uint());
}

}  // namespace
}  // namespace fogbank
