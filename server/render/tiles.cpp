#include "render/tiles.h"

#include <algorithm>
#include <numeric>

namespace fogbank::render {

namespace {

// Walks 1, 1, 2, 2, 3, 3, ... steps with a quarter turn after each, from the middle tile, and keeps what lies
// on the grid.
std::vector<uint32_t> spiral(const TileGrid& grid) {
  const auto columns = static_cast<int64_t>(grid.columns());
  const auto rows = static_cast<int64_t>(grid.rows());
  std::vector<uint32_t> order;
  order.reserve(grid.count());
  int64_t x = (columns - 1) / 2;
  int64_t y = (rows - 1) / 2;
  int64_t step_x = 1;
  int64_t step_y = 0;
  const auto visit = [&] {
    if (x >= 0 && x < columns && y >= 0 && y < rows) order.push_back(static_cast<uint32_t>(y * columns + x));
  };
  visit();
  for (int64_t leg = 2; order.size() < grid.count(); ++leg) {
    for (int64_t step = 0; step < leg / 2; ++step) {
      x += step_x;
      y += step_y;
      visit();
    }
    const int64_t turned = -step_y;
    step_y = step_x;
    step_x = turned;
  }
  return order;
}

}  // namespace

TileGrid::TileGrid(const scene::Window& crop, int32_t tile_size)
    : crop_(crop),
      tile_size_(tile_size),
      columns_(static_cast<uint32_t>((crop.width + tile_size - 1) / tile_size)),
      rows_(static_cast<uint32_t>((crop.height + tile_size - 1) / tile_size)) {}

scene::Window TileGrid::window(uint32_t index) const {
  const int32_t x = static_cast<int32_t>(index % columns_) * tile_size_;
  const int32_t y = static_cast<int32_t>(index / columns_) * tile_size_;
  return {crop_.x + x, crop_.y + y, std::min(tile_size_, crop_.width - x),
          std::min(tile_size_, crop_.height - y)};
}

TileGrid::Place TileGrid::locate(int32_t x, int32_t y) const {
  const int32_t column = x / tile_size_;
  const int32_t row = y / tile_size_;
  const uint32_t tile = static_cast<uint32_t>(row) * columns_ + static_cast<uint32_t>(column);
  const int32_t width = std::min(tile_size_, crop_.width - column * tile_size_);
  return {tile, static_cast<size_t>(y - row * tile_size_) * static_cast<size_t>(width) +
                    static_cast<size_t>(x - column * tile_size_)};
}

std::vector<uint32_t> visiting_order(const TileGrid& grid, TileOrder order,
                                     const std::optional<scene::Window>& first_region) {
  std::vector<uint32_t> tiles;
  if (order == TileOrder::spiral) {
    tiles = spiral(grid);
  } else {
    tiles.resize(grid.count());
    std::iota(tiles.begin(), tiles.end(), 0u);
  }
  if (first_region) {
    std::stable_partition(tiles.begin(), tiles.end(),
                          [&](uint32_t tile) { return overlap(grid.window(tile), *first_region); });
  }
  return tiles;
}

bool overlap(const scene::Window& a, const scene::Window& b) {
  return a.x < b.x + b.width && b.x < a.x + a.width && a.y < b.y + b.height && b.y < a.y + a.height;
}

}  // namespace fogbank::render
