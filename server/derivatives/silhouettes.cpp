#include "derivatives/silhouettes.h"

#include <algorithm>

namespace fogbank::derivatives {

namespace {

struct MixedEdge {
  uint64_t key;  ///< both vertices, the lower one first
  uint32_t triangle;
  uint32_t edge;
};

std::vector<MixedEdge> mixed_edges(const SeenGrid& seen) {
  const LightGrid& grid = seen.grid();
  std::vector<MixedEdge> edges;
  for (uint32_t t = 0; t < grid.triangles.size(); ++t) {
    const auto& vertices = grid.triangles[t].vertices;
    for (uint32_t e = 0; e < 3; ++e) {
      const uint32_t a = vertices[e];
      const uint32_t b = vertices[(e + 1) % 3];
      if (seen.visible(a) != seen.visible(b))
        edges.push_back({static_cast<uint64_t>(std::min(a, b)) << 32 | std::max(a, b), t, e});
    }
  }
  std::sort(edges.begin(), edges.end(), [](const MixedEdge& a, const MixedEdge& b) {
    return a.key != b.key ? a.key < b.key : a.triangle < b.triangle;
  });
  return edges;
}

}  // namespace

Silhouettes find_silhouettes(const SeenGrid& seen, bool with_blockers) {
  const LightGrid& grid = seen.grid();
  Silhouettes result;
  result.of_triangle.assign(grid.triangles.size(), {-1, -1, -1});
  const std::vector<MixedEdge> edges = mixed_edges(seen);
  for (size_t i = 0; i < edges.size(); ++i) {
    if (i == 0 || edges[i].key != edges[i - 1].key) {
      const auto low = static_cast<uint32_t>(edges[i].key >> 32);
      const auto high = static_cast<uint32_t>(edges[i].key);
      const bool low_visible = seen.visible(low);
      OutlinePoint& crossing = result.crossings.emplace_back();
      crossing.visible_vertex = low_visible ? low : high;
      crossing.blocked_vertex = low_visible ? high : low;
      crossing.on_border = true;
    } else {
      result.crossings.back().on_border = false;
    }
    result.of_triangle[edges[i].triangle][edges[i].edge] = static_cast<int32_t>(result.crossings.size()) - 1;
  }

  const size_t count = result.crossings.size();
  std::vector<double> last_visible(count, 0);  // shares of the way from the visible to the blocked end
  std::vector<Vec3d> targets(count);
  std::vector<Spectrum> through(count);
  const auto place = [&](size_t i, double share) {
    const OutlinePoint& crossing = result.crossings[i];
    return grid.between(grid.vertices[crossing.visible_vertex], grid.vertices[crossing.blocked_vertex],
                        share);
  };
  double step = 1;
  for (int bisection = 0; bisection < silhouette_bisections; ++bisection) {
    step *= 0.5;
    for (size_t i = 0; i < count; ++i) targets[i] = place(i, last_visible[i] + step);
    seen.test(targets, through);
    for (size_t i = 0; i < count; ++i) {
      if (!is_black(through[i])) last_visible[i] += step;
    }
  }
  // The middle of what is left is off by as much to either side; both its ends would be biased.
  for (size_t i = 0; i < count; ++i) result.crossings[i].far = place(i, last_visible[i] + 0.5 * step);
  if (!with_blockers) return result;
  for (size_t i = 0; i < count; ++i) targets[i] = place(i, last_visible[i] + step);
  const std::vector<double> distances = seen.blocker_distances(targets);
  for (size_t i = 0; i < count; ++i) {
    OutlinePoint& crossing = result.crossings[i];
    const double far = grid.at_infinity ? infinity : glm::length(crossing.far);
    // Nothing is met where rounding has the last word: no outline then, as far as derivatives go.
    crossing.has_blocker = distances[i] > 0 && distances[i] < far;
    if (crossing.has_blocker) crossing.near = glm::normalize(crossing.far) * distances[i];
  }
  return result;
}

}  // namespace fogbank::derivatives
