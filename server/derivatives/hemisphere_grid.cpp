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

uint32_t HemisphereGrid::side_for(int32_t directions) {
  uint32_t n = 2;
  while (n < 512 && static_cast<int64_t>(n) * n < directions) ++n;
  return n;
}

HemisphereGrid::HemisphereGrid(uint32_t n) : side_(n) {
  const auto last = static_cast<int32_t>(n) + 1;
  for (int32_t j = 1; j < last; ++j)
    for (int32_t i = 1; i < last; ++i) lattice_.emplace_back(i, j);
  // Once around, from the corner (0, 0) on, in the order that vertex_at counts.
  for (int32_t i = 0; i < last; ++i) lattice_.emplace_back(i, 0);
  for (int32_t j = 0; j < last; ++j) lattice_.emplace_back(last, j);
  for (int32_t i = last; i > 0; --i) lattice_.emplace_back(i, last);
  for (int32_t j = last; j > 0; --j) lattice_.emplace_back(0, j);
  const auto cell_at = [&](int32_t i, int32_t j) {
    return static_cast<uint32_t>((std::clamp(j, 1, last - 1) - 1) * static_cast<int32_t>(n) +
                                 std::clamp(i, 1, last - 1) - 1);
  };
  for (const Vec2i& point : lattice_) parents_.push_back(cell_at(point.x, point.y));
  neighbours_.resize(cell_count());
  for (uint32_t cell = 0; cell < cell_count(); ++cell) {
    size_t count = 0;
    for (int32_t dj = -1; dj <= 1; ++dj)
      for (int32_t di = -1; di <= 1; ++di) {
        if (di == 0 && dj == 0) continue;
        const Vec2i point = lattice_[cell] + Vec2i(di, dj);
        const bool inside = point.x > 0 && point.y > 0 && point.x < last && point.y < last;
        neighbours_[cell][count++] = inside ? cell_at(point.x, point.y) : cell;
      }
  }
  for (uint32_t j = 0; j <= n; ++j) {
    for (uint32_t i = 0; i <= n; ++i) {
      const uint32_t a = vertex_at(i, j);
      const uint32_t b = vertex_at(i + 1, j);
      const uint32_t c = vertex_at(i + 1, j + 1);
      const uint32_t d = vertex_at(i, j + 1);
      // Diagonals point to the middle, which leaves no triangle with all its corners on the horizon.
      if ((2 * i < n) == (2 * j < n)) {
        triangles_.push_back({a, b, c});
        triangles_.push_back({a, c, d});
      } else {
        triangles_.push_back({a, b, d});
        triangles_.push_back({b, c, d});
      }
    }
  }
  connect();
}

uint32_t HemisphereGrid::vertex_at(uint32_t i, uint32_t j) const {
  const uint32_t last = side_ + 1;
  if (i > 0 && j > 0 && i < last && j < last) return (j - 1) * side_ + i - 1;
  if (j == 0 && i < last) return cell_count() + i;
  if (i == last && j < last) return cell_count() + last + j;
  if (j == last && i > 0) return cell_count() + 2 * last + (last - i);
  return cell_count() + 3 * last + (last - j);
}

void HemisphereGrid::connect() {
  std::map<std::pair<uint32_t, uint32_t>, Edge> found;
  for (uint32_t t = 0; t < triangles_.size(); ++t)
    for (size_t k = 0; k < 3; ++k) {
      const uint32_t from = triangles_[t][k];
      const uint32_t to = triangles_[t][(k + 1) % 3];
      const auto [place, is_new] = found.try_emplace(std::minmax(from, to), Edge{from, to, t, no_triangle});
      if (!is_new) place->second.right = t;
    }
  const auto add = [&](bool inner) {
    for (const auto& [ends, edge] : found)
      if ((ends.second < cell_count()) == inner) edges_.push_back(edge);
  };
  add(true);
  inner_edge_count_ = edges_.size();
  add(false);
  triangle_edges_.resize(triangles_.size());
  for (uint32_t e = 0; e < edges_.size(); ++e) {
    const Edge& edge = edges_[e];
    for (const uint32_t t : {edge.left, edge.right}) {
      if (t == no_triangle) continue;
      for (size_t k = 0; k < 3; ++k)
        if (std::minmax(triangles_[t][k], triangles_[t][(k + 1) % 3]) == std::minmax(edge.a, edge.b))
          triangle_edges_[t][k] = e;
    }
  }
}

Vec3f HemisphereGrid::direction(uint32_t vertex, const Vec2f& u) const {
  const Vec2f lattice(lattice_[vertex]);
  const auto n = static_cast<float>(side_);
  if (vertex < cell_count()) {
    const Vec2f disk = square_to_disk_concentric((lattice - 1.0f + u) / n);
    return {disk, safe_sqrt(1 - glm::dot(disk, disk))};
  }
  // The border of the square is the circle.
  const Vec2f disk = square_to_disk_concentric(glm::clamp((lattice - 0.5f) / n, Vec2f(0), Vec2f(1)));
  return {glm::normalize(disk), 0};
}

}  // namespace fogbank::derivatives
