#include "transport/shadow_map.h"

#include <algorithm>
#include <array>
#include <cmath>

namespace fogbank::transport {

namespace {

/// Where the medium's boundary differs by more than this optical distance from a plane over neighbouring
/// cells, the way through the medium is no guess at all.
constexpr float most_uneven = 0.05f;
/// More surfaces than this that pass light before a solid one are not followed.
constexpr int most_passed_surfaces = 16;
/// By which the grid is wider than what it covers.
constexpr float grid_margin = 1e-3f;

struct Range {
  Vec3f lower{infinity};
  Vec3f upper{-infinity};

  void add(const Vec3f& point) {
    lower = glm::min(lower, point);
    upper = glm::max(upper, point);
  }
};

/// In the coordinates of `frame`.
Range range_of(const scene::BoundingSphere& ball, const Extent& extent, const Frame& frame) {
  Range range;
  if (std::isfinite(extent.lower.x)) {
    for (int corner = 0; corner < 8; ++corner)
      range.add(frame.to_local({(corner & 1) != 0 ? extent.upper.x : extent.lower.x,
                                (corner & 2) != 0 ? extent.upper.y : extent.lower.y,
                                (corner & 4) != 0 ? extent.upper.z : extent.lower.z}));
  } else {
    range.add(frame.to_local(ball.center) - Vec3f(ball.radius));
    range.add(frame.to_local(ball.center) + Vec3f(ball.radius));
  }
  return range;
}

}  // namespace

ShadowMap::ShadowMap(const World& world, uint32_t light, int32_t medium, int32_t side)
    : world_(world),
      medium_(medium),
      side_(side),
      frame_(Frame::from_normal(-world.lights().light(light).direction_from(world.scene().bounds.center))),
      tiles_(static_cast<size_t>(side / tile_side)),
      slots_(std::make_unique<Slot[]>(tiles_ * tiles_)) {
  const scene::BoundingSphere& ball = world.scene().bounds;
  const Range range = range_of(ball, world.medium(medium).extent, frame_);
  const Vec3f size = glm::max(range.upper - range.lower, Vec3f(1e-6f * ball.radius));
  corner_ = range.lower - grid_margin * size;
  corner_.z = glm::dot(ball.center, frame_.normal) - (1 + grid_margin) * ball.radius;
  scale_ = static_cast<float>(side) / ((1 + 2 * grid_margin) * Vec2f(size));
}

ShadowMap::Line ShadowMap::line(const Vec3f& origin, const Vec3f& direction) const {
  const Vec3f scale(scale_, 1);
  return {(frame_.to_local(origin) - corner_) * scale, frame_.to_local(direction) * scale};
}

ShadowMap::Answer ShadowMap::at(const Vec3f& place, RayCounters& counters) const {
  const auto side = static_cast<float>(side_);
  if (!(place.x >= 0 && place.x < side && place.y >= 0 && place.y < side)) return {};
  const auto column = static_cast<size_t>(place.x);
  const auto row = static_cast<size_t>(place.y);
  constexpr auto within = static_cast<size_t>(tile_side);
  const Cell& cell =
      tile(row / within * tiles_ + column / within, counters)[row % within * within + column % within];
  const Vec2f from_middle = Vec2f(place) - Vec2f(static_cast<float>(column), static_cast<float>(row)) - 0.5f;
  const float boundary = cell.boundary + glm::dot(cell.slope, from_middle);
  const float behind = std::isfinite(boundary) ? std::fmax(place.z - boundary, 0.0f) : 0.0f;
  if (place.z < cell.nearest) return {Guess::lit, behind};
  if (place.z > cell.farthest) return {Guess::dark, behind};
  return {Guess::uncertain, behind};
}

const ShadowMap::Tile& ShadowMap::tile(size_t index, RayCounters& counters) const {
  Slot& slot = slots_[index];
  if (!slot.ready.load(std::memory_order_acquire))
    std::call_once(slot.once, [&] {
      slot.tile = make_tile(index, counters);
      slot.ready.store(true, std::memory_order_release);
    });
  return slot.tile;
}

template <typename Near>
ShadowMap::Cell ShadowMap::make_cell(const Near& near, float sigma) {
  Cell cell{infinity, 0, near(0, 0).boundary, Vec2f(0)};
  // What lies behind a solid surface is dark whatever bounds it.
  const auto is_lit = [&](int32_t x, int32_t y) { return near(x, y).boundary <= near(x, y).solid; };
  const auto slope = [&](int32_t x, int32_t y) {
    return is_lit(x, y) && is_lit(-x, -y) ? 0.5f * (near(x, y).boundary - near(-x, -y).boundary) : 0.0f;
  };
  cell.slope = {slope(1, 0), slope(0, 1)};
  bool clear = true;
  bool even = true;
  for (int32_t y = -1; y <= 1; ++y)
    for (int32_t x = -1; x <= 1; ++x) {
      cell.nearest = std::fmin(cell.nearest, near(x, y).solid);
      cell.farthest = std::fmax(cell.farthest, near(x, y).solid);
      clear = clear && near(x, y).clear;
      if (!is_lit(x, y)) continue;
      const float expected =
          cell.boundary + cell.slope.x * static_cast<float>(x) + cell.slope.y * static_cast<float>(y);
      even = even && sigma * std::fabs(near(x, y).boundary - expected) < most_uneven;
    }
  if (!clear || !even) cell.nearest = -infinity;
  if (!clear) cell.farthest = infinity;
  return cell;
}

ShadowMap::Tile ShadowMap::make_tile(size_t index, RayCounters& counters) const {
  constexpr int32_t rim = tile_side + 2;
  const auto first_column = static_cast<int32_t>(index % tiles_) * tile_side - 1;
  const auto first_row = static_cast<int32_t>(index / tiles_) * tile_side - 1;
  std::vector<Met> met;
  met.reserve(static_cast<size_t>(rim) * rim);
  for (int32_t row = 0; row < rim; ++row)
    for (int32_t column = 0; column < rim; ++column)
      met.push_back(trace(first_column + column, first_row + row, counters));
  const float sigma = world_.medium(medium_).mean_sigma_t;
  Tile tile;
  tile.reserve(static_cast<size_t>(tile_side) * tile_side);
  for (int32_t row = 0; row < tile_side; ++row)
    for (int32_t column = 0; column < tile_side; ++column) {
      const auto near = [&](int32_t x, int32_t y) -> const Met& {
        return met[static_cast<size_t>((row + 1 + y) * rim + column + 1 + x)];
      };
      tile.push_back(make_cell(near, sigma));
    }
  return tile;
}

ShadowMap::Met ShadowMap::trace(int32_t column, int32_t row, RayCounters& counters) const {
  const Vec2f place = (Vec2f(static_cast<float>(column), static_cast<float>(row)) + 0.5f) / scale_;
  Ray rest{frame_.to_world(corner_ + Vec3f(place, 0)), frame_.normal, infinity};
  const scene::Scene& scene = world_.scene();
  Met met;
  scene::Hit hit;
  ++counters.closest_hit;
  if (scene.intersector->intersect_solid(rest, hit)) met.solid = hit.distance;
  if (!scene.intersector->has_passing_surfaces()) return met;
  float walked = 0;
  int passed = 0;
  while (true) {
    rest.max_distance = met.solid - walked;
    ++counters.closest_hit;
    if (!(rest.max_distance > 0) || !scene.intersector->intersect_passing(rest, hit)) return met;
    const scene::SurfaceInteraction surface = scene.interaction(rest, hit);
    walked += hit.distance;
    if (!world_.is_null(surface.shape) || ++passed > most_passed_surfaces) met.clear = false;
    if (!met.clear) return met;
    if (scene.shapes[surface.shape].is_medium_boundary) {
      const int32_t beyond = world_.medium_beyond(surface, rest.direction, scene::none);
      if (beyond == medium_ && !std::isfinite(met.boundary)) {
        met.boundary = walked;
      } else if (beyond != scene::none) {
        met.clear = false;
        return met;
      }
    }
    rest.origin = surface.spawn_origin(rest.direction);
  }
}

}  // namespace fogbank::transport
