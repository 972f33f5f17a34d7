#include "derivatives/hemisphere_grid.h"

#include <algorithm>
#include <map>
#include <mutex>

#include "core/sampling.h"

namespace fogbank::derivatives {

std::shared_ptr<const HemisphereGrid> HemisphereGrid::of(uint32_t n) {
  static std::mutex mutex;
  static std::map<uint32_t, std::shared_ptr<const HemisphereGrid>> grids;
  const std::lock_guard lock(mutex);
  std::shared_ptr<const HemisphereGrid>& grid = grids[n];
  if (!grid) grid = std::shared_ptr<const HemisphereGrid>(new HemisphereGrid(n));
  return grid;
}

HemisphereGrid::HemisphereGrid(uint32_t n) : n_(n) {
  const uint32_t row = n + 1;
  std::map<std::pair<uint32_t, uint32_t>, size_t> edge_of;
  const auto add = [&](uint32_t a, uint32_t b, uint32_t c) {
    const auto triangle = static_cast<uint32_t>(triangles_.size());
    triangles_.push_back({a, b, c});
    for (const auto& [from, to] : {std::pair{a, b}, std::pair{b, c}, std::pair{c, a}}) {
      const auto [place, is_new] =
          edge_of.try_emplace({std::min(from, to), std::max(from, to)}, edges_.size());
      if (is_new)
        edges_.push_back({from, to, triangle, no_triangle});
      else
        edges_[place->second].right = triangle;
    }
  };
  for (uint32_t j = 0; j < n; ++j) {
    for (uint32_t i = 0; i < n; ++i) {
      const uint32_t corner = j * row + i;
      // Diagonals point to the middle, which leaves no triangle with all its corners on the border.
      if ((i < n / 2) == (j < n / 2)) {
        add(corner, corner + 1, corner + row + 1);
        add(corner, corner + row + 1, corner + row);
      } else {
        add(corner, corner + 1, corner + row);
        add(corner + 1, corner + row + 1, corner + row);
      }
    }
  }
}

bool HemisphereGrid::on_border(uint32_t vertex) const {
  const uint32_t i = vertex % (n_ + 1);
  const uint32_t j = vertex / (n_ + 1);
  return i == 0 || j == 0 || i == n_ || j == n_;
}

Vec3f HemisphereGrid::direction(uint32_t vertex, const Vec2f& jitter) const {
  Vec2f place(static_cast<float>(vertex % (n_ + 1)), static_cast<float>(vertex / (n_ + 1)));
  if (!on_border(vertex)) place += 0.35f * jitter;
  Vec2f disk = square_to_disk_concentric(place / static_cast<float>(n_));
  const float greatest = std::sqrt(1 - horizon_sine * horizon_sine);
  const float radius = glm::length(disk);
  if (radius > greatest) disk *= greatest / radius;
  return {disk, safe_sqrt(1 - glm::dot(disk, disk))};
}

}  // namespace fogbank::derivatives
