// Where the outlines of blockers cross the edges of a light's grid.
#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "derivatives/seen_grid.h"

namespace fogbank::derivatives {

/// Bisections of each mixed edge: 1/128 of the edge on the average between the outline and what is taken for
/// it.
inline constexpr int silhouette_bisections = 6;

/// The two vertices that stand for an outline on an edge with one visible and one blocked end.
struct OutlinePoint {
  uint32_t visible_vertex = 0;
  uint32_t blocked_vertex = 0;
  bool on_border = false;  ///< the edge belongs to one triangle only: an outline of the light itself
  Vec3d far{0};            ///< on the light; a unit direction for lights at infinity
  bool has_blocker = false;
  Vec3d near{0};  ///< in the same direction on the blocker, relative to x
};

/// Crossings, and for edge i (from vertex i to vertex i + 1) of every triangle its crossing or -1.
struct Silhouettes {
  std::vector<OutlinePoint> crossings;
  std::vector<std::array<int32_t, 3>> of_triangle;
};

/// Bisects every mixed edge (method.md section 6.2), all of them in step. Blockers are looked for only where
/// `with_blockers`; without, `near` stays 0.
Silhouettes find_silhouettes(const SeenGrid& seen, bool with_blockers);

}  // namespace fogbank::derivatives
