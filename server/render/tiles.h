// The crop window cut into tiles, and the order in which a pass visits them.
#pragma once

#include <cstdint>
#include <optional>
#include <vector>

#include "render/render_settings.h"
#include "scene/sensor.h"

namespace fogbank::render {

/// Tiles of `tile_size` pixels a side from the crop window's upper left corner, numbered row by row; those at
/// the right and lower edge are cut off.
class TileGrid {
 public:
  TileGrid(const scene::Window& crop, int32_t tile_size);

  uint32_t columns() const { return columns_; }
  uint32_t rows() const { return rows_; }
  uint32_t count() const { return columns_ * rows_; }
  scene::Window window(uint32_t index) const;
  /// A pixel of the crop window, as seen from its corner.
  struct Place {
    uint32_t tile = 0;
    size_t pixel = 0;  ///< of the tile, row by row
  };
  Place locate(int32_t x, int32_t y) const;

 private:
  scene::Window crop_;
  int32_t tile_size_;
  uint32_t columns_;
  uint32_t rows_;
};

/// Every tile's index once. scan: row by row; spiral: around the middle of the crop window outwards, as what
/// matters mostly is in the middle. Tiles that overlap `first_region` come first, in the same order among
/// themselves.
std::vector<uint32_t> visiting_order(const TileGrid& grid, TileOrder order,
                                     const std::optional<scene::Window>& first_region);

bool overlap(const scene::Window& a, const scene::Window& b);

}  // namespace fogbank::render
