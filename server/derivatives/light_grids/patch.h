// Structured patches of (columns + 1) x (rows + 1) vertices, which most kinds of lights are made of.
#pragma once

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

/// Mean of a texture over the uv triangle: the centroids of 16 equal parts. Exact for constants.
Spectrum mean_radiance(const scene::Texture& texture, const Vec2f& a, const Vec2f& b, const Vec2f& c);

/// Fills in the radiance of all triangles from the uv of all vertices.
void set_radiance(const scene::Texture& texture, const std::vector<Vec2f>& uvs, LightGrid& grid);

}  // namespace fogbank::derivatives
