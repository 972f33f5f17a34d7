// Stratified directions over the whole sphere, joined to a closed triangulation (method.md section 2.1).
#pragma once

#include <array>
#include <cstdint>
#include <memory>
#include <span>
#include <vector>

#include "core/random.h"
#include "core/ray_counters.h"
#include "core/vector.h"

namespace fogbank::derivatives {

/// The n x n cells of the equal-area octahedral map, n even, and the triangles between their midpoints. Cells
/// are numbered so that a run of 16 is a tile of 4 x 4 where n allows: rays traced in that order are
/// coherent. Immutable.
class DirectionTopology {
 public:
  /// Counter-clockwise seen from the sphere's middle: for vertices in the unjittered directions
  /// r1 . (r2 x r3) > 0.
  using Triangle = std::array<uint32_t, 3>;
  /// An edge from `a` to `b` as `left` traverses it; `right` traverses it backwards.
  struct Edge {
    uint32_t a = 0;
    uint32_t b = 0;
    uint32_t left = 0;
    uint32_t right = 0;
  };

  /// The one topology for `n` (even, 4 to 1024), built when it is first asked for. Throws Interrupted, also
  /// while it waits for another thread that builds.
  static std::shared_ptr<const DirectionTopology> of(int32_t n, const RayCounters& counters = {});
  /// Smallest n with n^2 >= `directions`, even, 4 to 1024.
  static int32_t side_for(int32_t directions);

  int32_t side() const { return side_; }
  size_t size() const { return cells_.size(); }
  /// All 2 n^2 - 4 triangles; each edge is shared by two of them.
  std::span<const Triangle> triangles() const { return triangles_; }
  /// In an order in which neighbours are close.
  std::span<const Edge> edges() const { return edges_; }
  /// For each triangle the edges behind its first, second and third vertex.
  std::span<const std::array<uint32_t, 3>> triangle_edges() const { return triangle_edges_; }
  /// Up to 8 vertices around each one, filled up with the vertex itself; symmetric.
  const std::vector<std::array<uint32_t, 8>>& neighbours() const { return neighbours_; }
  /// Column and row of a vertex's cell in the octahedral square.
  const std::vector<Vec2i>& cells() const { return cells_; }

 private:
  DirectionTopology(int32_t n, const RayCounters& counters);
  /// Finds the edges between the triangles.
  void connect(const RayCounters& counters);

  int32_t side_;
  std::vector<Vec2i> cells_;
  std::vector<Triangle> triangles_;
  std::vector<Edge> edges_;
  std::vector<std::array<uint32_t, 3>> triangle_edges_;
  std::vector<std::array<uint32_t, 8>> neighbours_;
};

/// The equal-area octahedral map from [-1, 1]^2 to unit directions (method.md section 2.1).
Vec3d octahedral_direction(double a, double b);

/// One unit direction a cell, in the topology's order: at a place drawn from the middle half of the cell's
/// sides ("half jitter": fewer inverted triangles at nearly the same variance), all turned by one uniform
/// random rotation. Draws only from `random`. Throws Interrupted.
std::vector<Vec3f> stratified_directions(const DirectionTopology& topology, RandomStream& random,
                                         const RayCounters& counters = {});

}  // namespace fogbank::derivatives
