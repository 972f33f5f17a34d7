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

/// Distances below `least_distance` count as it. Triangles with no vertex that is `lit` (one flag a ray) are
/// left out. Throws Interrupted.
SphereMesh make_sphere_mesh(const SphereRays& rays, const Outlines& outlines, std::span<const uint8_t> lit,
                            float least_distance, const RayCounters& counters);

}  // namespace fogbank::derivatives
