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
  // 0.1 s a sample so far.
  EXPECT_EQ(samples_of_next_pass(0, 1000, 1024, 0.0, 60.0), 1u);
  EXPECT_EQ(samples_of_next_pass(16, 1000, 1024, 1.6, 60.0), 16u) << "an eighth of the budget is 75 samples";
  EXPECT_EQ(samples_of_next_pass(200, 100000, 64, 20.0, 60.0), 75u) << "an eighth of the budget";
  EXPECT_EQ(samples_of_next_pass(560, 100000, 64, 56.0, 60.0), 36u) << "nine tenths of the 4 s left";
  EXPECT_EQ(samples_of_next_pass(599, 100000, 64, 59.95, 60.0), 0u) << "no sample fits";
  EXPECT_EQ(samples_of_next_pass(700, 100000, 64, 70.0, 60.0), 0u) << "over the budget";
  EXPECT_EQ(samples_of_next_pass(990, 1000, 1024, 1.0, 60.0), 10u)
      << "all samples come before the budget's end";
  EXPECT_EQ(samples_of_next_pass(1, 1000, 1024, 10.0, 60.0), 1u) << "never less than one where one fits";
}

}  // namespace
}  // namespace fogbank::render
