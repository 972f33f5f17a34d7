#include "derivatives/silhouettes.h"

#include <algorithm>

namespace fogbank::derivatives {

namespace {

struct MixedEdge {
  uint64_t key;  ///< both vertices, the lower one first
  uint32_t triangle;
  uint32_t edge;
};

std::vector<MixedEdge> mixed_edges(const LightGrid& grid, const std::vector<uint8_t>& visible) {
  std::vector<MixedEdge> edges;
  for (uint32_t t = 0; t < grid.triangles.size(); ++t) {
    const auto& vertices = grid.triangles[t].vertices;
    for (uint32_t e = 0; e < 3; ++e) {
      const uint64_t a = vertices[e];
      const uint64_t b = vertices[(e + 1) % 3];
      if (visible[a] != visible[b]) edges.push_back({std::min(a, b) << 32 | std::max(a, b), t, e});
    }
  }
  std::sort(edges.begin(), edges.end(), [](const MixedEdge& a, const MixedEdge& b) {
    return a.key != b.key ? a.key < b.key : a.triangle < b.triangle;
  });
  return edges;
}

}  // namespace

Silhouettes find_silhouettes(const LightGrid& grid, const std::vector<uint8_t>& visible,
                             const LightRays& rays, bool with_blockers) {
  Silhouettes result;
  result.of_triangle.assign(grid.triangles.size(), {-1, -1, -1});
  const std::vector<MixedEdge> edges = mixed_edges(grid, visible);
  for (size_t i = 0; i < edges.size(); ++i) {
    if (i == 0 || edges[i].key != edges[i - 1].key) {
      const auto low = static_cast<uint32_t>(edges[i].key >> 32);
      const auto high = static_cast<uint32_t>(edges[i].key);
      const bool low_visible = visible[low] != 0;
      result.crossings.push_back(
          {low_visible ? low : high, low_visible ? high : low, true, Vec3d(0), Vec3d(0)});
    } else {
      result.crossings.back().on_border = false;
    }
    result.of_triangle[edges[i].triangle][edges[i].edge] = static_cast<int32_t>(result.crossings.size()) - 1;
  }

  const size_t count = result.crossings.size();
  std::vector<double> last_visible(count, 0);  // shares of the way from the visible to the blocked end
  std::vector<Vec3d> targets(count);
  std::vector<uint8_t> seen(count);
  const auto place = [&](size_t i, double share) {
    const Crossing& crossing = result.crossings[i];
    return grid.between(grid.vertices[crossing.visible_vertex], grid.vertices[crossing.blocked_vertex],
                        share);
  };
  double step = 1;
  for (int bisection = 0; bisection < silhouette_bisections; ++bisection) {
    step *= 0.5;
    for (size_t i = 0; i < count; ++i) targets[i] = place(i, last_visible[i] + step);
    rays.visible(targets, grid.at_infinity, seen);
    for (size_t i = 0; i < count; ++i) {
      if (seen[i] != 0) last_visible[i] += step;
    }
  }
  for (size_t i = 0; i < count; ++i) {
    Crossing& crossing = result.crossings[i];
    // The middle of what is left is off by as much to either side; both its ends would be biased.
    crossing.far = place(i, last_visible[i] + 0.5 * step);
    if (!with_blockers) continue;
    const double far = glm::length(crossing.far);
    double near = rays.blocker_distance(place(i, last_visible[i] + step), grid.at_infinity);
    if (!(near > 0) || !(near < (grid.at_infinity ? infinity : far))) near = grid.at_infinity ? 0 : far;
    crossing.near = crossing.far * (near / far);
  }
  return result;
}

}  // namespace fogbank::derivatives
