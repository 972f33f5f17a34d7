// Triangle meshes in world space.
#pragma once

#include <string>
#include <vector>

#include "core/vector.h"

namespace fogbank::scene {

/// `normals` and `uvs` are empty or have one entry per position. Triangles index `positions`;
/// counter-clockwise seen from the side the geometric normal points to. `positions` should have capacity for
/// one more than it holds (the readers see to it): the intersector can then use it in place instead of
/// copying it.
struct Mesh {
  std::vector<Vec3f> positions;
  std::vector<Vec3f> normals;
  std::vector<Vec2f> uvs;
  std::vector<Vec3u> triangles;
  bool faceted = false;          ///< without vertex normals on purpose: none are to be made
  size_t dropped_triangles = 0;  ///< of the file's, for having no area
};

}  // namespace fogbank::scene
