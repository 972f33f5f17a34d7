// The kinds of lights that light_grid.cpp makes grids of; one file each.
#pragma once

#include <vector>

#include "derivatives/light_grid.h"

namespace fogbank::derivatives {

using GriddedLightPointer = std::unique_ptr<const GriddedLight>;

GriddedLightPointer grid_rectangle(const transport::RectangleShape& shape, int32_t n, double least_distance);
GriddedLightPointer grid_disk(const transport::DiskShape& shape, int32_t n, double least_distance);
/// From outside the visible cap, by equal solid angles; its outline is a polygon of the cap's solid angle.
GriddedLightPointer grid_sphere(const transport::SphereShape& shape, int32_t n, double least_distance);
GriddedLightPointer grid_cylinder(const transport::CylinderShape& shape, int32_t n, double least_distance);
/// All triangles of one shape, cut by angle until there are 2 n^2. If more than `most_mesh_triangles(n)` face
/// x, a systematic sample of them, drawn in proportion to what they would send unoccluded, is traced, and the
/// rest enters by closed form: sum over all of the unoccluded light minus sum over the sample of what is
/// blocked, over its probability.
GriddedLightPointer grid_mesh(const std::vector<transport::TriangleShape>& triangles, int32_t n);
constexpr size_t most_mesh_triangles(int32_t n) {
  return 8 * static_cast<size_t>(n) * static_cast<size_t>(n);
}

/// Some 8 n^2 cells of much the same energy, fixed once for all points. `light` must outlive it.
GriddedLightPointer grid_image_environment(const transport::ImageShape& shape, const transport::Light& light,
                                           int32_t n);

}  // namespace fogbank::derivatives
