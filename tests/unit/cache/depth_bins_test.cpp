#include "cache/depth_bins.h"

#include <gtest/gtest.h>

#include <set>

#include "core/random.h"
#include "core/sampling.h"

namespace fogbank::cache {
namespace {

TEST(DepthBins, CodesRoundDownByAtMostAFifth) {
  RandomStream random(1, 0, 0, 0);
  for (int i = 0; i < 10000; ++i) {
    const float distance =
        std::ldexp(1 + random.next_float(), static_cast<int>(random.next_float() * 62) - 31);
    const float kept = DepthBins::decode(DepthBins::encode(distance));
    EXPECT_LE(kept, distance);
    EXPECT_GE(kept, 0.8f * distance);
  }
}

TEST(DepthBins, EveryCodeIsItsOwn) {
  for (int code = 1; code < 256; ++code)
    EXPECT_EQ(DepthBins::encode(DepthBins::decode(static_cast<uint8_t>(code))), code);
}

TEST(DepthBins, EndsOfTheScale) {
  EXPECT_EQ(DepthBins::decode(DepthBins::encode(0)), 0);
  EXPECT_EQ(DepthBins::decode(DepthBins::encode(1e-30f)), 0);
  EXPECT_EQ(DepthBins::decode(1), 0x1p-32f);
  EXPECT_EQ(DepthBins::encode(infinity), 255);
  EXPECT_EQ(DepthBins::decode(255), 0x1.8p31f);
}

TEST(DepthBins, BinsHaveAboutEqualArea) {
  // Cells of the octahedral map differ in solid angle by up to a factor 3 sqrt(3) = 5.2 (corners against
  // centres of octants); 40 000 directions put 625 into an average one.
  RandomStream random(2, 0, 0, 0);
  std::array<int, DepthBins::count> hits{};
  for (int i = 0; i < 40000; ++i) ++hits[DepthBins::bin(square_to_uniform_sphere(random.next_vec2()))];
  for (const int count : hits) {
    EXPECT_GT(count, 200);
    EXPECT_LT(count, 1800);
  }
}

TEST(DepthBins, BinsAreConnected) {
  // Directions 1e-3 apart are in the same bin or across one border; a map with a wrong fold would scatter the
  // lower hemisphere.
  RandomStream random(3, 0, 0, 0);
  std::array<Vec3f, DepthBins::count> sums{};
  std::array<float, DepthBins::count> counts{};
  for (int i = 0; i < 40000; ++i) {
    const Vec3f direction = square_to_uniform_sphere(random.next_vec2());
    sums[DepthBins::bin(direction)] += direction;
    counts[DepthBins::bin(direction)] += 1;
  }
  // Vectors of a compact cell of some 0.2 sr nearly add up; the widest cells span about 0.7 rad.
  for (uint32_t bin = 0; bin < DepthBins::count; ++bin)
    EXPECT_GT(glm::length(sums[bin]) / counts[bin], 0.9f) << bin;
}

TEST(DepthBins, InsertKeepsTheNearest) {
  DepthBins bins;
  EXPECT_TRUE(bins.reaches({1000, 0, 0}));
  bins.insert({2, 0, 0}, 3.0f);
  bins.insert({1, 0, 0}, 5.0f);
  EXPECT_TRUE(bins.reaches({2, 0, 0}));
  EXPECT_FALSE(bins.reaches({3, 0, 0}));
  EXPECT_TRUE(bins.reaches({-100, 0, 0}));
  EXPECT_TRUE(bins.reaches({0, 0, 0}));
}

TEST(DepthBins, AxesAndExtremes) {
  DepthBins bins;
  for (int axis = 0; axis < 3; ++axis) {
    for (const float sign : {-1.0f, 1.0f}) {
      for (const float length : {1e-18f, 1.0f, 1e18f}) {
        Vec3f direction(0);
        direction[axis] = sign * length;
        EXPECT_LT(DepthBins::bin(direction), DepthBins::count);
      }
    }
  }
}

}  // namespace
}  // namespace fogbank::cache
