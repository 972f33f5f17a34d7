// Structured patches of (columns + 1) x (rows + 1) vertices, which most kinds of lights are made of.
#pragma once

#include <algorithm>
#include <cmath>
#include <vector>

#include "core/random.h"
#include "derivatives/light_grid.h"

namespace fogbank::derivatives {

/// Vertices of a patch in [0, 1]^2, row by row. Inner ones are moved at random by up to 0.35 of a cell, those
/// on the border along it if `slide_border` (method.md section 7).
std::vector<Vec2d> patch_points(int32_t columns, int32_t rows, bool slide_border, RandomStream& random);

/// Appends two triangles a cell, diagonals alternating, over vertices that begin at `first`:
/// counter-clockwise in the patch's parameters, or clockwise if `mirrored`.
void append_patch_triangles(int32_t columns, int32_t rows, uint32_t first, bool mirrored, LightGrid& grid);

/// The unit square to the unit disk (Shirley and Chiu 1997).
Vec2d square_to_disk(const Vec2d& u);
/// Radius at which the regular polygon through the 4 n border points has the disk's area.
double disk_border_radius(int32_t n);

/// Mean of `radiance_at(point)` over the triangle (a, b, c) of any space: the centroids of 16 equal parts.
template <typename Point, typename RadianceAt>
Spectrum mean_over_triangle(const Point& a, const Point& b, const Point& c, const RadianceAt& radiance_at) {
  constexpr int parts = 4;
  Spectrum sum(0);
  const auto add = [&](double u, double v) {
    using Real = Point::value_type;
    sum += radiance_at(a + (b - a) * static_cast<Real>(u / parts) + (c - a) * static_cast<Real>(v / parts));
  };
  for (int i = 0; i < parts; ++i) {
    for (int j = 0; i + j < parts; ++j) {
      add(i + 1.0 / 3, j + 1.0 / 3);
      if (i + j + 1 < parts) add(i + 2.0 / 3, j + 2.0 / 3);
    }
  }
  return sum * (1.0f / (parts * parts));
}

/// Fills in the radiance of all triangles; `points` are the vertices in some parameters and
/// `uv_of(parameters)` the texture's.
template <typename UvOf>
void set_radiance(const scene::Texture& texture, const std::vector<Vec2d>& points, const UvOf& uv_of,
                  LightGrid& grid) {
  const Spectrum constant = texture.is_constant() ? texture.evaluate(Vec2f(0)) : Spectrum(0);
  for (LightGrid::Triangle& triangle : grid.triangles) {
    const auto& [a, b, c] = triangle.vertices;
    triangle.radiance = texture.is_constant()
                            ? constant
                            : mean_over_triangle(points[a], points[b], points[c],
                                                 [&](const Vec2d& p) { return texture.evaluate(uv_of(p)); });
  }
}

}  // namespace fogbank::derivatives
