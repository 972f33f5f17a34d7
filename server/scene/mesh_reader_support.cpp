#include "scene/mesh_reader_support.h"

#include "scene/scene_file_reader.h"

#include <algorithm>
#include <utility>

#include "scene/loader.h"
#include "scene/mesh_normals.h"

namespace fogbank::scene {

namespace {

bool has_area(const Mesh& mesh, const Vec3u& t) {
  const Vec3d p0(mesh.positions[t.x]);
  const Vec3d n = glm::cross(Vec3d(mesh.positions[t.y]) - p0, Vec3d(mesh.positions[t.z]) - p0);
  return n != Vec3d(0);
}

}  // namespace

void MeshFile::fail(ErrorKind kind, const std::string& reason, const std::string& message) const {
  throw SceneError(kind, reason, where_, options_.path.empty() ? message : options_.path + ": " + message);
}

void MeshFile::damaged(const std::string& place, const std::string& message) const {
  fail(ErrorKind::invalid_argument, "DAMAGED_MESH", place + ": " + message);
}
void MeshFile::damaged_at_line(size_t line, const std::string& message) const {
  damaged("line " + std::to_string(line), message);
}
void MeshFile::damaged_at_byte(size_t offset, const std::string& message) const {
  damaged("byte " + std::to_string(offset), message);
}

void MeshFile::check_triangle_count(uint64_t count) const {
  if (count > LoadLimits::triangles)
    fail(ErrorKind::resource_exhausted, "TOO_MANY_TRIANGLES",
         "more than " + std::to_string(LoadLimits::triangles) + " triangles");
}

Mesh MeshFile::finish(Mesh mesh) const {
  const auto count = static_cast<uint64_t>(mesh.positions.size());
  for (size_t i = 0; i < mesh.triangles.size(); ++i) {
    const Vec3u& t = mesh.triangles[i];
    const uint32_t largest = std::max({t.x, t.y, t.z});
    if (largest >= count)
      damaged("triangle " + std::to_string(i), "refers to vertex " + std::to_string(largest) + " of " +
                                                   std::to_string(count) + " (counted from 0)");
  }
  for (size_t i = 0; i < mesh.positions.size(); ++i) {
    const bool finite = is_finite(mesh.positions[i]) &&
                        (mesh.normals.empty() || is_finite(mesh.normals[i])) &&
                        (mesh.uvs.empty() || (std::isfinite(mesh.uvs[i].x) && std::isfinite(mesh.uvs[i].y)));
    if (!finite) damaged("vertex " + std::to_string(i), "has a value that is not a finite number");
  }
  if (mesh.triangles.empty()) fail(ErrorKind::invalid_argument, "EMPTY_MESH", "has no triangles");

  const size_t before = mesh.triangles.size();
  std::erase_if(mesh.triangles, [&mesh](const Vec3u& t) { return !has_area(mesh, t); });
  mesh.dropped_triangles = before - mesh.triangles.size();
  if (mesh.triangles.empty())
    fail(ErrorKind::invalid_argument, "EMPTY_MESH",
         "none of its " + std::to_string(before) + " triangles has an area");

  if (options_.flip_tex_coords) {
    for (Vec2f& uv : mesh.uvs) uv.y = 1.0f - uv.y;
  }
  mesh.faceted = options_.face_normals;
  if (mesh.faceted) {
    mesh.normals = {};
  } else if (options_.max_smooth_angle_degrees) {
    smooth_up_to_angle(mesh, *options_.max_smooth_angle_degrees);
  }
  mesh.positions.reserve(mesh.positions.size() + 1);
  return mesh;
}

Mesh read_mesh(const std::string& bytes, const MeshFileRequest& request, const SourceLocation& where) {
  if (request.type == "obj") return read_obj(bytes, request.options, where);
  if (request.type == "ply") return read_ply(bytes, request.options, where);
  return read_serialized(bytes, request.shape_index, request.options, where);
}

}  // namespace fogbank::scene
