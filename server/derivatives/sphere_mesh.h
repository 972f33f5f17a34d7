// The closed triangulation around a point: a direction grid's triangles, split along outlines.
#pragma once

#include <span>
#include <vector>

#include "derivatives/form_factor_batch.h"
#include "derivatives/outlines.h"

namespace fogbank::derivatives {

/// Vertices: one for each ray, then two for each outline (on the near surface, and just past it on the far
/// one).
struct SphereMesh {
  std::vector<BatchVertex<float>> vertices;
  std::vector<BatchTriangle> triangles;
  std::vector<uint32_t> rays;  ///< for each vertex the ray whose surface it lies on
};

/// Ends of lines in all directions, and the triangles between them.
struct JoinedEnds {
  std::span<const Vec3f> directions;
  std::span<const RayEnd> ends;  ///< one a direction
  std::span<const DirectionTopology::Triangle> triangles;
  /// Of each triangle, from its first, second and third vertex on: those that `Outlines::of_edge` numbers.
  std::span<const std::array<uint32_t, 3>> triangle_edges;
};

/// Distances below `least_distance` count as it. Triangles with no vertex that is `lit` (one flag a
/// direction) are left out. Throws Interrupted.
SphereMesh make_sphere_mesh(const JoinedEnds& grid, const Outlines& outlines, std::span<const uint8_t> lit,
                            float least_distance, const RayCounters& counters);

}  // namespace fogbank::derivatives
