#include "render/tiles.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <set>

namespace fogbank::render {
namespace {

TEST(Tiles, CoverTheCropOnce) {
  for (const scene::Window crop :
       {scene::Window{0, 0, 64, 64}, {5, 9, 97, 61}, {3, 3, 1, 1}, {0, 0, 300, 8}}) {
    const TileGrid grid(crop, 16);
    std::vector<int> hits(static_cast<size_t>(crop.width * crop.height));
    for (uint32_t tile = 0; tile < grid.count(); ++tile) {
      const scene::Window window = grid.window(tile);
      EXPECT_LE(window.width, 16);
      EXPECT_LE(window.height, 16);
      for (int32_t y = window.y; y < window.y + window.height; ++y) {
        for (int32_t x = window.x; x < window.x + window.width; ++x) {
          ++hits.at(static_cast<size_t>((y - crop.y) * crop.width + x - crop.x));
        }
      }
    }
    EXPECT_TRUE(std::all_of(hits.begin(), hits.end(), [](int count) { return count == 1; }));
  }
}

TEST(Tiles, EveryOrderVisitsEachOnce) {
  for (const auto& [width, height] : {std::pair{160, 96}, {16, 16}, {700, 16}, {16, 700}, {33, 31}}) {
    const TileGrid grid({0, 0, width, height}, 16);
    for (const TileOrder order : {TileOrder::scan, TileOrder::spiral}) {
      const std::vector<uint32_t> tiles = visiting_order(grid, order, std::nullopt);
      EXPECT_EQ(tiles.size(), grid.count());
      EXPECT_EQ(std::set<uint32_t>(tiles.begin(), tiles.end()).size(), grid.count());
      EXPECT_LT(*std::max_element(tiles.begin(), tiles.end()), grid.count());
    }
  }
}

TEST(Tiles, SpiralRunsFromTheMiddleOutwards) {
  const TileGrid grid({0, 0, 80, 80}, 16);  // 5 x 5
  EXPECT_EQ(visiting_order(grid, TileOrder::spiral, std::nullopt),
            (std::vector<uint32_t>{12, 13, 18, 17, 16, 11, 6, 7, 8, 9, 14, 19, 24,
                                   23, 22, 21, 20, 15, 10, 5, 0, 1, 2, 3,  4}));
}

TEST(Tiles, RegionComesFirst) {
  const TileGrid grid({0, 0, 80, 80}, 16);
  const scene::Window region{0, 60, 17, 8};  // rows 3 and 4 of columns 0 and 1
  EXPECT_EQ(visiting_order(grid, TileOrder::scan, region),
            (std::vector<uint32_t>{15, 16, 20, 21, 0,  1,  2,  3,  4,  5,  6,  7, 8,
                                   9,  10, 11, 12, 13, 14, 17, 18, 19, 22, 23, 24}));
}

}  // namespace
}  // namespace fogbank::render
