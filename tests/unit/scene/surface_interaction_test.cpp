// What shading is told about a hit.
#include <gtest/gtest.h>

#include "scene/scene_builders.h"

namespace fogbank::scene::test {
namespace {

SurfaceInteraction look(const Scene& scene, const Ray& ray) {
  Hit hit;
  EXPECT_TRUE(scene.intersector->intersect(ray, hit));
  const SurfaceInteraction surface = scene.interaction(ray, hit);
  EXPECT_EQ(surface.distance, hit.distance);
  return surface;
}

void expect_near(const Vec3f& actual, const Vec3f& expected, float tolerance) {
  for (int axis = 0; axis < 3; ++axis)
    EXPECT_NEAR(actual[axis], expected[axis], tolerance) << "axis " << axis;
}

// Expected numbers of the triangles below were computed with Mitsuba 3.9.1 (scalar_rgb,
// `scene.ray_intersect`) for the same ray and mesh; it works in single precision and prints six digits, hence
// the tolerance.
constexpr float printed = 2e-5f;
const Ray probe{{0.2f, 0.3f, 5.0f}, {0, 0, -1}, infinity};

TEST(SurfaceInteractionTest, TriangleWithoutUvUsesBarycentricCoordinates) {
  Scene scene;
  add_mesh(scene, triangle({0, 0, 0}, {1, 0, 0}, {0, 1, 0}));
  build(scene);
  const SurfaceInteraction s = look(scene, probe);
  expect_near(s.position, {0.2f, 0.3f, 0.0f}, printed);
  expect_near(s.geometric_normal, {0, 0, 1}, 0);
  expect_near(s.shading_normal, {0, 0, 1}, 0);
  EXPECT_NEAR(s.uv.x, 0.2f, printed);
  EXPECT_NEAR(s.uv.y, 0.3f, printed);
  expect_near(s.dp_du, {1, 0, 0}, 0);
  expect_near(s.dp_dv, {0, 1, 0}, 0);
}

TEST(SurfaceInteractionTest, VertexNormalsAreInterpolatedAndNotTurned) {
  Mesh mesh = triangle({0, 0, 0}, {1, 0, 0}, {0, 1, 0});
  mesh.normals = {glm::normalize(Vec3f(0, 0.3f, 1)), glm::normalize(Vec3f(0.5f, 0, 1)), {0, 0, 1}};
  Scene scene;
  add_mesh(scene, mesh);
  build(scene);
  expect_near(look(scene, probe).shading_normal, {0.09196f, 0.14772f, 0.98475f}, printed);

  // Clockwise: the geometric normal follows the vertex order, the shading normal keeps to the file.
  scene.meshes[0].triangles[0] = {0, 2, 1};
  build(scene);
  SurfaceInteraction s = look(scene, probe);
  expect_near(s.geometric_normal, {0, 0, -1}, 0);
  expect_near(s.shading_normal, {0.09196f, 0.14772f, 0.98475f}, printed);
  EXPECT_NEAR(s.uv.x, 0.3f, printed);
  EXPECT_NEAR(s.uv.y, 0.2f, printed);

  scene.shapes[0].flip_normals = true;
  s = look(scene, probe);
  expect_near(s.geometric_normal, {0, 0, 1}, 0);
  expect_near(s.shading_normal, {-0.09196f, -0.14772f, -0.98475f}, printed);
}

TEST(SurfaceInteractionTest, CancellingVertexNormalsFallBackToTheFace) {
  Mesh mesh = triangle({0, 0, 0}, {1, 0, 0}, {0, 1, 0});
  mesh.normals = {{1, 0, 0}, {-1, 0, 0}, {0, 0, 1}};
  Scene scene;
  add_mesh(scene, mesh);
  build(scene);
  Hit hit;
  hit.distance = 5;
  hit.parameters = {0.5f, 0.0f};
  expect_near(scene.interaction(probe, hit).shading_normal, {0, 0, 1}, 0);
}

TEST(SurfaceInteractionTest, DerivativesFollowTheUvs) {
  Mesh mesh = triangle({0, 0, 0}, {1, 0, 0}, {0, 1, 0});
  mesh.uvs = {{0.1f, 0.8f}, {0.9f, 0.7f}, {0.05f, 0.2f}};
  Scene scene;
  add_mesh(scene, mesh);
  build(scene);
  const SurfaceInteraction s = look(scene, probe);
  EXPECT_NEAR(s.uv.x, 0.245f, printed);
  EXPECT_NEAR(s.uv.y, 0.6f, printed);
  expect_near(s.dp_du, {1.23711f, -0.20619f, 0}, printed);
  expect_near(s.dp_dv, {-0.10309f, -1.64948f, 0}, printed);

  scene.meshes[0].uvs = {{0.5f, 0.5f}, {0.5f, 0.5f}, {0.5f, 0.5f}};
  const SurfaceInteraction degenerate = look(scene, probe);
  EXPECT_NEAR(glm::length(glm::cross(degenerate.dp_du, degenerate.dp_dv)), 1.0f, printed);
}

TEST(SurfaceInteractionTest, MirroredInstanceKeepsTheOutside) {
  Mesh mesh = triangle({0, 0, 0}, {1, 0, 0}, {0, 1, 0});
  mesh.normals = {glm::normalize(Vec3f(0, 0.3f, 1)), glm::normalize(Vec3f(0.5f, 0, 1)), {0, 0, 1}};
  Scene scene;
  scene.group_count = 1;
  add_mesh(scene, mesh, 0);
  Mat4d mirror(1.0);
  mirror[2][2] = -1;
  scene.instances = {{0, mirror}};
  build(scene);
  const SurfaceInteraction s = look(scene, probe);
  expect_near(s.geometric_normal, {0, 0, -1}, 0);
  expect_near(s.shading_normal, {0.0919591f, 0.147716f, -0.984745f}, printed);
  expect_near(s.dp_du, {1, 0, 0}, 0);
  expect_near(s.dp_dv, {0, 1, 0}, 0);
}

}  // namespace
}  // namespace fogbank::scene::test
