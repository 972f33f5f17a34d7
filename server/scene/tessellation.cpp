#include "scene/tessellation.h"

#include <utility>

namespace fogbank::scene {
namespace {

/// Square with corners center -+ u -+ v, whose uv grows along u and v, seen from the side that `normal` (u x
/// v or its opposite) points to.
void add_face(Mesh& mesh, const Vec3f& center, const Vec3f& u, const Vec3f& v, const Vec3f& normal) {
  const auto first = static_cast<uint32_t>(mesh.positions.size());
  for (const Vec2f corner : {Vec2f(-1, -1), Vec2f(1, -1), Vec2f(1, 1), Vec2f(-1, 1)}) {
    mesh.positions.push_back(center + corner.x * u + corner.y * v);
    mesh.normals.push_back(normal);
    mesh.uvs.push_back(0.5f * (corner + 1.0f));
  }
  const bool is_counter_clockwise = glm::dot(glm::cross(u, v), normal) > 0;
  for (const Vec3u& triangle : {Vec3u(0, 1, 2), Vec3u(0, 2, 3)})
    mesh.triangles.push_back(first +
                             (is_counter_clockwise ? triangle : Vec3u(triangle.x, triangle.z, triangle.y)));
}

}  // namespace

Mesh rectangle_mesh() {
  Mesh mesh;
  add_face(mesh, {0, 0, 0}, {1, 0, 0}, {0, 1, 0}, {0, 0, 1});
  return mesh;
}

Mesh cube_mesh() {
  // Mitsuba's uv are mirrored on every face: v x u is the outward normal.
  struct Face {
    Vec3f u;
    Vec3f v;
  };
  Mesh mesh;
  for (const Face& face :
       {Face{{0, 0, 1}, {1, 0, 0}}, Face{{-1, 0, 0}, {0, 0, -1}}, Face{{0, 1, 0}, {0, 0, -1}},
        Face{{0, 1, 0}, {1, 0, 0}}, Face{{0, 1, 0}, {0, 0, 1}}, Face{{0, -1, 0}, {1, 0, 0}}}) {
    const Vec3f normal = glm::cross(face.v, face.u);
    add_face(mesh, normal, face.u, face.v, normal);
  }
  return mesh;
}

void transform_mesh(Mesh& mesh, const Mat4d& to_world) {
  const glm::dmat3 linear(to_world);
  const glm::dmat3 normal_matrix = glm::transpose(glm::inverse(linear));
  for (Vec3f& position : mesh.positions) position = Vec3f(Vec3d(to_world * glm::dvec4(Vec3d(position), 1.0)));
  for (Vec3f& normal : mesh.normals) {
    const Vec3d turned = normal_matrix * Vec3d(normal);
    const double length = glm::length(turned);
    // A vertex without a direction keeps none; shading falls back to the face's normal there.
    normal = length > 0 ? Vec3f(turned / length) : Vec3f(0);
  }
  if (!mesh.normals.empty() && glm::determinant(linear) < 0)
    for (Vec3u& triangle : mesh.triangles) std::swap(triangle.y, triangle.z);
}

double surface_area(const Mesh& mesh) {
  double doubled = 0;
  for (const Vec3u& triangle : mesh.triangles) {
    const Vec3d origin(mesh.positions[triangle.x]);
    doubled += glm::length(
        glm::cross(Vec3d(mesh.positions[triangle.y]) - origin, Vec3d(mesh.positions[triangle.z]) - origin));
  }
  return 0.5 * doubled;
}

}  // namespace fogbank::scene
