// Where parallel light gets to, on a grid across its direction (Williams 1978, "Casting curved shadows on
// curved surfaces"): a guess at visibility that estimators sample by and leave the truth to rays.
#pragma once

#include <atomic>
#include <cstdint>
#include <memory>
#include <mutex>
#include <vector>

#include "core/frame.h"
#include "core/ray_counters.h"
#include "transport/world.h"

namespace fogbank::transport {

/// Of one directional light in one medium. Cells are traced in tiles when they are first asked for, so that
/// only what is looked at costs rays; what they hold doesn't depend on who asks. Safe from any thread that
/// has called `scene::prepare_render_thread`.
class ShadowMap {
 public:
  enum class Guess : uint8_t {
    lit,
    dark,
    uncertain,  ///< edges of shadows are near, or the light passes more than the medium's boundary
  };
  struct Answer {
    Guess guess = Guess::uncertain;
    float behind_boundary = 0;  ///< way of the light through the medium; 0 where that is not known
  };
  /// Points of a line in the map's coordinates: cells across the light, distance along it.
  struct Line {
    Vec3f origin{0};
    Vec3f direction{0};  ///< of a unit length in the world
  };

  /// A grid of `side` x `side` cells, a multiple of `tile_side`, over the medium or, where that has no
  /// bounds, over the scene. `light`: directional.
  ShadowMap(const World& world, uint32_t light, int32_t medium, int32_t side);

  static constexpr int32_t tile_side = 32;

  Line line(const Vec3f& origin, const Vec3f& direction) const;
  Answer at(const Vec3f& place, RayCounters& counters) const;

 private:
  struct Cell {
    float nearest = 0;   ///< solid surface that the light meets, over the cell and the eight around it
    float farthest = 0;  ///< the same
    float boundary = 0;  ///< where it enters the medium, at the middle of the cell
    Vec2f slope{0};      ///< of `boundary`, per cell
  };
  using Tile = std::vector<Cell>;
  /// What one ray along the light meets.
  struct Met {
    float solid = infinity;
    float boundary = infinity;
    bool clear = true;  ///< nothing else
  };

  const Tile& tile(size_t index, RayCounters& counters) const;
  /// `near(x, y)`: what a cell `x` columns and `y` rows away meets, -1 to 1.
  template <typename Near>
  static Cell make_cell(const Near& near, float sigma);
  Tile make_tile(size_t index, RayCounters& counters) const;
  Met trace(int32_t column, int32_t row, RayCounters& counters) const;

  const World& world_;
  int32_t medium_;
  int32_t side_;
  Frame frame_;      ///< normal: along the light
  Vec3f corner_{0};  ///< in the frame: of the grid, and where distances begin
  Vec2f scale_{0};   ///< cells per metre
  size_t tiles_;     ///< a side
  struct Slot {
    std::once_flag once;
    std::atomic<bool> ready = false;
    Tile tile;
  };
  std::unique_ptr<Slot[]> slots_;
};

}  // namespace fogbank::transport
