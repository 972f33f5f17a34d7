#include "cache/thinning.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <span>

#include "core/random.h"
#include "core/sampling.h"

namespace fogbank::cache {
namespace {

/// In a unit cube; spacings over two orders of magnitude.
std::vector<SpacedWish> random_wishes(size_t count) {
  RandomStream random(3, 0, 0, 0);
  std::vector<SpacedWish> wishes(count);
  for (SpacedWish& wish : wishes) {
    wish.wish.position = {random.next_float(), random.next_float(), random.next_float()};
    wish.spacing = 0.3f * std::pow(10.0f, -2 * random.next_float());
  }
  return wishes;
}

TEST(Thinning, RefusedWishesHaveAGrantedOneInReachAndGrantedOnesAreApart) {
  const std::vector<SpacedWish> wishes = random_wishes(2000);
  std::vector<uint32_t> granted = thin(wishes, 1, wishes.size());
  std::ranges::sort(granted);
  const auto distance = [&](uint32_t a, uint32_t b) {
    return glm::distance(wishes[a].wish.position, wishes[b].wish.position);
  };
  for (uint32_t i = 0; i < wishes.size(); ++i) {
    if (std::ranges::binary_search(granted, i)) continue;
    EXPECT_TRUE(std::ranges::any_of(granted, [&](uint32_t g) { return distance(i, g) < wishes[g].spacing; }));
  }
  // Of two, the one that came second wasn't in reach of the first.
  for (const uint32_t a : granted) {
    for (const uint32_t b : granted) {
      if (a != b) {
        EXPECT_GE(distance(a, b), std::min(wishes[a].spacing, wishes[b].spacing));
      }
    }
  }
}

TEST(Thinning, DependsOnTheWishesAsASet) {
  std::vector<SpacedWish> wishes = random_wishes(500);
  const auto places = [&] {
    std::vector<std::array<float, 3>> result;
    for (const uint32_t i : thin(wishes, 7, wishes.size())) {
      const Vec3f& p = wishes[i].wish.position;
      result.push_back({p.x, p.y, p.z});
    }
    std::ranges::sort(result);
    return result;
  };
  const auto expected = places();
  std::ranges::reverse(wishes);
  EXPECT_EQ(places(), expected);
  wishes.insert(wishes.end(), wishes.begin(), wishes.begin() + 100);
  EXPECT_EQ(places(), expected);
}

TEST(Thinning, WhoeverStopsEarlyHasServedAllPlacesAlike) {
  // Wishes come in the order of the pixels that have them.
  std::vector<SpacedWish> wishes = random_wishes(4000);
  for (SpacedWish& wish : wishes) wish.spacing = 0.01f;
  std::ranges::sort(wishes, {}, [](const SpacedWish& wish) { return wish.wish.position.y; });
  const std::vector<uint32_t> all = thin(wishes, 1, wishes.size());
  const size_t part = all.size() / 8;
  const std::vector<uint32_t> first = thin(wishes, 1, part);
  EXPECT_TRUE(std::ranges::equal(first, std::span(all).first(part)));
  const auto upper =
      std::ranges::count_if(first, [&](uint32_t i) { return wishes[i].wish.position.y > 0.5f; });
  // Four standard deviations of a binomial distribution.
  EXPECT_NEAR(static_cast<double>(upper), 0.5 * static_cast<double>(part),
              2 * std::sqrt(static_cast<double>(part)));
}

TEST(Thinning, NormalsAndComponentsThatDifferDoNotForbid) {
  std::vector<SpacedWish> wishes(4, {{}, 1.0f});
  wishes[0].wish.normal = {0, 0, 1};
  wishes[1].wish.normal = {0, 0, -1};
  wishes[2].wish.normal = {0, 0, 1};
  wishes[2].wish.component.quantity = Quantity::irradiance;
  EXPECT_EQ(thin(wishes, 0, 10).size(), 4u);
  wishes[1].wish.normal = {0, 0, 1};
  EXPECT_EQ(thin(wishes, 0, 10).size(), 3u);
  EXPECT_EQ(thin(wishes, 0, 2).size(), 2u);
  EXPECT_TRUE(thin(wishes, 0, 0).empty());
}

}  // namespace
}  // namespace fogbank::cache
