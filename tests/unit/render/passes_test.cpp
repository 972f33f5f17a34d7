#include "render/passes.h"

#include <gtest/gtest.h>

#include <vector>

namespace fogbank::render {
namespace {

std::vector<uint32_t> passes(uint32_t samples, uint32_t pixels_of_a_tile) {
  std::vector<uint32_t> sizes;
  uint32_t done = 0;
  while (const uint32_t size = samples_of_next_pass(done, samples, pixels_of_a_tile)) {
    sizes.push_back(size);
    done += size;
  }
  EXPECT_EQ(done, samples);
  EXPECT_EQ(sizes.size(), count_passes(samples, pixels_of_a_tile));
  return sizes;
}

TEST(Passes, DoubleUntilAnEighthOfTheWhole) {
  EXPECT_EQ(passes(1, 1024), (std::vector<uint32_t>{1}));
  EXPECT_EQ(passes(4, 1024), (std::vector<uint32_t>{1, 1, 1, 1}));
  EXPECT_EQ(passes(16, 1024), (std::vector<uint32_t>{1, 1, 2, 2, 2, 2, 2, 2, 2}));
  EXPECT_EQ(passes(64, 1024), (std::vector<uint32_t>{1, 1, 2, 4, 8, 8, 8, 8, 8, 8, 8}));
  EXPECT_EQ(passes(100, 1024), (std::vector<uint32_t>{1, 1, 2, 4, 8, 13, 13, 13, 13, 13, 13, 6}));
}

TEST(Passes, TasksStaySmall) {
  for (const uint32_t size : passes(1u << 14, 1024)) EXPECT_LE(size * 1024, 1u << 16);
  for (const uint32_t size : passes(1u << 14, 128 * 128)) EXPECT_LE(size * 128 * 128, 1u << 16);
  for (const uint32_t samples : {1u, 2u, 3u, 5u, 17u, 999u, 1u << 20}) passes(samples, 64);
}

TEST(Passes, BudgetLimitsAPass) {
  const auto of_a_minute = [](uint32_t done, uint32_t in_all, uint32_t pixels, double seconds_left) {
    return samples_of_next_pass(done, in_all, pixels, {seconds_left, 60.0, 0.1});
  };
  EXPECT_EQ(of_a_minute(0, 1000, 1024, 60.0), 1u);
  EXPECT_EQ(of_a_minute(16, 1000, 1024, 58.4), 16u) << "an eighth of the budget is 75 samples";
  EXPECT_EQ(of_a_minute(200, 100000, 64, 40.0), 75u) << "an eighth of the budget";
  EXPECT_EQ(of_a_minute(560, 100000, 64, 4.0), 36u) << "nine tenths of the 4 s left";
  EXPECT_EQ(of_a_minute(599, 100000, 64, 0.05), 0u) << "no sample fits";
  EXPECT_EQ(of_a_minute(700, 100000, 64, -10.0), 0u) << "over the budget";
  EXPECT_EQ(of_a_minute(990, 1000, 1024, 59.0), 10u) << "all samples come before the budget's end";
  EXPECT_EQ(samples_of_next_pass(1, 1000, 1024, {50.0, 60.0, 10.0}), 1u)
      << "never less than one where one fits";
}

}  // namespace
}  // namespace fogbank::render
