// Stratified directions over a hemisphere, as cells of the unit disk below it (Malley's method): equal cells
// of the disk are equal shares of irradiance.
#pragma once

#include <cstdint>
#include <memory>
#include <span>
#include <vector>

#include "derivatives/direction_grid.h"

namespace fogbank::derivatives {

/// The n x n cells of the concentric map (Shirley and Chiu 1997), then a ring of 4 (n + 1) vertices on the
/// horizon around them, all joined by triangles that fill the hemisphere. Immutable.
class HemisphereGrid {
 public:
  using Triangle = DirectionTopology::Triangle;
  using Edge = DirectionTopology::Edge;
  /// Of Edge::right at the horizon.
  static constexpr uint32_t no_triangle = 0xffffffffu;

  /// Shared by all who ask for the same n, 2 to 512.
  static std::shared_ptr<const HemisphereGrid> of(uint32_t n);
  /// Smallest n with n^2 >= `directions`, 2 to 512.
  static uint32_t side_for(int32_t directions);

  uint32_t side() const { return side_; }
  uint32_t cell_count() const { return side_ * side_; }
  size_t vertex_count() const { return parents_.size(); }
  /// Counter-clockwise seen from the normal's tip: form factors of unjittered ones are positive.
  std::span<const Triangle> triangles() const { return triangles_; }
  std::span<const Edge> edges() const { return edges_; }
  /// The edges between cells, which are the first ones.
  std::span<const Edge> inner_edges() const { return edges().first(inner_edge_count_); }
  /// For each triangle the edges from its first, second and third vertex on.
  std::span<const std::array<uint32_t, 3>> triangle_edges() const { return triangle_edges_; }
  /// Up to 8 cells around each one, filled up with the cell itself; symmetric.
  const std::vector<std::array<uint32_t, 8>>& neighbours() const { return neighbours_; }
  /// The cell that a vertex of the horizon lies next to; cells are their own.
  uint32_t parent(uint32_t vertex) const { return parents_[vertex]; }

  /// Unit direction, z along the normal. A cell's is that of its place `u` in [0, 1)^2 within the cell;
  /// vertices of the horizon have z = 0 and leave `u` aside.
  Vec3f direction(uint32_t vertex, const Vec2f& u) const;

 private:
  explicit HemisphereGrid(uint32_t n);
  /// Number of a lattice point, 0 to n + 1 either way; the outermost ones are the horizon's.
  uint32_t vertex_at(uint32_t i, uint32_t j) const;
  void connect();

  uint32_t side_;
  size_t inner_edge_count_ = 0;
  std::vector<Vec2i> lattice_;  ///< of each vertex
  std::vector<uint32_t> parents_;
  std::vector<Triangle> triangles_;
  std::vector<Edge> edges_;
  std::vector<std::array<uint32_t, 3>> triangle_edges_;
  std::vector<std::array<uint32_t, 8>> neighbours_;
};

}  // namespace fogbank::derivatives
