// What holds of every mesh that a reader returns.
#pragma once

#include <algorithm>

#include "fuzz.h"
#include "scene/mesh_normals.h"
#include "scene/mesh_readers.h"

namespace fogbank::fuzz {

inline void check_mesh(const scene::Mesh& mesh) {
  const size_t vertices = mesh.positions.size();
  require(!mesh.triangles.empty(), "a mesh has triangles");
  require(mesh.normals.empty() || mesh.normals.size() == vertices, "a normal for each vertex, or none");
  require(mesh.uvs.empty() || mesh.uvs.size() == vertices, "a texture coordinate for each vertex, or none");
  for (const Vec3u& triangle : mesh.triangles)
    require(std::max({triangle.x, triangle.y, triangle.z}) < vertices, "indices are in range");
  const auto finite = [](const auto& v) { return is_finite(v); };
  require(std::ranges::all_of(mesh.positions, finite), "positions are finite");
  require(std::ranges::all_of(mesh.normals, finite), "normals are finite");
  for (const Vec2f& uv : mesh.uvs) require(std::isfinite(uv.x) && std::isfinite(uv.y), "uv are finite");
}

/// `read` takes MeshReadOptions.
template <typename Read>
void check_reader(const Read& read) {
  scene::MeshReadOptions options{
      .path = "mesh", .face_normals = false, .flip_tex_coords = false, .max_smooth_angle_degrees = {}};
  if (!accepts([&] { check_mesh(read(options)); })) return;
  options.flip_tex_coords = true;
  options.max_smooth_angle_degrees = 30;
  require(accepts([&] { check_mesh(read(options)); }), "options refuse no mesh");
  scene::Mesh mesh =
      read({.path = "mesh", .face_normals = true, .flip_tex_coords = false, .max_smooth_angle_degrees = {}});
  scene::complete_vertex_normals(mesh);
  check_mesh(mesh);
}

}  // namespace fogbank::fuzz
