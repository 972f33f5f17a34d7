// Triangulations without a natural grid: refined by halving longest edges, so that no vertex ever lies inside
// a neighbour's edge.
#pragma once

#include <array>
#include <cstdint>
#include <functional>
#include <unordered_map>
#include <vector>

#include "core/random.h"
#include "core/vector.h"

namespace fogbank::derivatives {

/// Splits the most important triangle until there are enough. A split halves the triangle's longest edge
/// after its neighbours have made that edge their longest too (longest-edge propagation, Rivara 1997).
class Refinement {
 public:
  struct Triangle {
    std::array<uint32_t, 3> vertices{};
    std::array<Vec2f, 3> uvs{};
    uint32_t source = 0;  ///< the triangle it was cut from, for the caller
  };

  /// Triangles that were split become the first of their halves; the second is appended. Whoever keeps data
  /// by triangle follows with `on_split(first half, second half, new vertex, opposite vertex)`.
  using OnSplit = std::function<void(uint32_t, uint32_t, uint32_t, uint32_t)>;

  /// Vertices relative to the point from which edges are measured, by their angle.
  Refinement(std::vector<Vec3d> vertices, std::vector<Triangle> triangles, bool on_sphere);

  const std::vector<Vec3d>& vertices() const { return vertices_; }
  const std::vector<Triangle>& triangles() const { return triangles_; }

  /// `importance(triangle)`: 0 or less is never split. Edges are cut at their middle plus up to `jitter` of
  /// their length.
  void refine(size_t triangles, const std::function<double(uint32_t)>& importance, double jitter,
              RandomStream& random, const OnSplit& on_split = {});
  /// Angle of the longest edge.
  double width(uint32_t triangle) const;

 private:
  static uint64_t key(uint32_t a, uint32_t b) {
    return static_cast<uint64_t>(a < b ? a : b) << 32 | (a < b ? b : a);
  }
  double angle(uint32_t a, uint32_t b) const;
  /// Index of the longest edge; of equal ones that with the lowest key, so that neighbours agree.
  size_t longest_edge(const Triangle& triangle) const;
  void split_edge(uint32_t a, uint32_t b, double share, const OnSplit& on_split);

  std::vector<Vec3d> vertices_;
  std::vector<Triangle> triangles_;
  std::unordered_map<uint64_t, std::vector<uint32_t>> of_edge_;  ///< triangles at each edge
  bool on_sphere_;
  std::vector<uint32_t> changed_;
};

/// Unit directions and a closed triangulation of them, counter-clockwise seen from outside.
struct DirectionMesh {
  std::vector<Vec3d> directions;
  std::vector<std::array<uint32_t, 3>> triangles;
};
/// The 8 faces of an octahedron.
DirectionMesh octahedron();
/// The octahedron refined to at least `triangles` of much the same size.
DirectionMesh uniform_directions(size_t triangles);
/// Uniform over all rotations (Shoemake 1992).
glm::dmat3 random_rotation(RandomStream& random);

}  // namespace fogbank::derivatives
