// Small scenes built in memory, for tests of geometry.
#pragma once

#include <memory>
#include <utility>

#include "scene/scene.h"

namespace fogbank::scene::test {

/// Adds a mesh and a shape for it; returns the shape's index.
inline uint32_t add_mesh(Scene& scene, Mesh mesh, int32_t group = none) {
  Shape shape;
  shape.mesh = static_cast<int32_t>(scene.meshes.size());
  shape.group = group;
  scene.meshes.push_back(std::move(mesh));
  scene.shapes.push_back(shape);
  return static_cast<uint32_t>(scene.shapes.size() - 1);
}

inline uint32_t add_round_shape(Scene& scene, ShapeKind kind, const Mat4d& to_world, int32_t group = none) {
  Shape shape;
  shape.kind = kind;
  shape.to_world = to_world;
  shape.group = group;
  scene.shapes.push_back(shape);
  return static_cast<uint32_t>(scene.shapes.size() - 1);
}

inline void build(Scene& scene) { scene.intersector = std::make_unique<Intersector>(scene); }

inline Mesh triangle(const Vec3f& a, const Vec3f& b, const Vec3f& c) {
  Mesh mesh;
  mesh.positions = {a, b, c};
  mesh.triangles = {{0, 1, 2}};
  return mesh;
}

/// Square of side 2 in the plane z = `z`, normal +z.
inline Mesh square(float z) {
  Mesh mesh;
  mesh.positions = {{-1, -1, z}, {1, -1, z}, {1, 1, z}, {-1, 1, z}};
  mesh.triangles = {{0, 1, 2}, {0, 2, 3}};
  return mesh;
}

/// Closed latitude-longitude sphere without duplicated vertices; outward normals.
Mesh globe(int rings, int segments);

/// The mesh mapped by `scale * p + offset`, rounded to single precision.
inline Mesh moved(Mesh mesh, double scale, const Vec3d& offset) {
  for (Vec3f& p : mesh.positions) p = Vec3f(scale * Vec3d(p) + offset);
  return mesh;
}

inline Mat4d translation(const Vec3d& t) {
  Mat4d m(1.0);
  m[3] = glm::dvec4(t, 1.0);
  return m;
}

}  // namespace fogbank::scene::test
