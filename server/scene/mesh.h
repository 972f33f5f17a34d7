// Triangle meshes in world space.
#pragma once

#include <string>
#include <vector>

#include "core/vector.h"

namespace fogbank::scene {

/// `normals` and `uvs` are empty or have one entry per position. Triangles index `positions`;
/// counter-clockwise seen from the side the geometric normal points to.
struct Mesh {
  std::vector<Vec3f> positions;
  std::vector<Vec3f> normals;
  std::vector<Vec2f> uvs;
  std::vector<Vec3u> triangles;
};

}  // namespace fogbank::scene
