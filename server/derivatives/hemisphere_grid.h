// Directions of a hemisphere as a lattice on the unit disk below it (Malley's method): equal cells of the
// disk are equal shares of irradiance.
#pragma once

#include <array>
#include <cstdint>
#include <memory>
#include <vector>

#include "core/vector.h"

namespace fogbank::derivatives {

/// (n + 1)^2 lattice points, mapped to the disk by the concentric map (Shirley and Chiu 1997), the lattice's
/// border to the horizon; two triangles a cell, counter-clockwise seen from the point below. Immutable.
class HemisphereGrid {
 public:
  struct Edge {
    uint32_t from, to;  ///< vertices
    uint32_t left;      ///< triangle on the left of from -> to, seen from the point below
    uint32_t right;     ///< on the right; no_triangle at the horizon
  };
  static constexpr uint32_t no_triangle = 0xFFFFFFFFu;
  /// Sine of the elevation that the horizon's vertices are lifted to, so that rays don't graze the surface
  /// they start on.
  static constexpr float horizon_sine = 0.02f;

  /// Shared by all who ask for the same n; 2 <= n <= 512.
  static std::shared_ptr<const HemisphereGrid> of(uint32_t n);

  uint32_t cells_a_side() const { return n_; }
  size_t vertex_count() const { return (n_ + 1) * (n_ + 1); }
  const std::vector<std::array<uint32_t, 3>>& triangles() const { return triangles_; }
  const std::vector<Edge>& edges() const { return edges_; }
  bool on_border(uint32_t vertex) const;

  /// Unit direction, z along the normal, of a vertex moved within its surroundings by `jitter` in [-1, 1]^2
  /// (of 0.35 of a cell; not at the border).
  Vec3f direction(uint32_t vertex, const Vec2f& jitter) const;

 private:
  explicit HemisphereGrid(uint32_t n);

  uint32_t n_;
  std::vector<std::array<uint32_t, 3>> triangles_;
  std::vector<Edge> edges_;
};

}  // namespace fogbank::derivatives
