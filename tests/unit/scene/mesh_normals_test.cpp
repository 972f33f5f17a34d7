// Vertex normals made by us.
#include "scene/mesh_normals.h"

#include <gtest/gtest.h>

#include "scene/mesh_readers.h"

namespace fogbank::scene::test {
namespace {

const std::string three_vertices = "v 0 0 0\nv 1 0 0\nv 0 1 0\n";

Mesh obj(const std::string& text, const MeshReadOptions& options = {}) {
  return read_obj(text, options, {"scene.xml", 1, "<shape>"});
}

// Numbers of Mitsuba 3.9.1 for the same two triangles (a fold along the diagonal).
TEST(MeshNormalsTest, MissingNormalsAreThoseOfMitsuba) {
  const std::string text = three_vertices + "v 1 1 .5\nf 1 2 3\nf 3 2 4\n";
  Mesh mesh = obj(text);
  complete_vertex_normals(mesh);
  const Vec3f expected[] = {{0, 0, 1},
                            {-0.22704612f, -0.22704612f, 0.94704807f},
                            {-0.22704612f, -0.22704612f, 0.94704807f},
                            {-0.40824828f, -0.40824828f, 0.81649655f}};
  for (size_t i = 0; i < 4; ++i)
    for (int axis = 0; axis < 3; ++axis) EXPECT_NEAR(mesh.normals[i][axis], expected[i][axis], 2e-7f) << i;

  MeshReadOptions options;
  options.face_normals = true;
  Mesh faceted = obj(text, options);
  complete_vertex_normals(faceted);
  EXPECT_TRUE(faceted.normals.empty());
}

TEST(MeshNormalsTest, OnlyMissingOnesAreMade) {
  Mesh mesh = obj(three_vertices + "v 1 1 0\nvn 0 1 0\nf 1//1 2//1 3//1\nf 3 2 4\n");
  complete_vertex_normals(mesh);
  EXPECT_EQ(mesh.normals[0], Vec3f(0, 1, 0));
  EXPECT_EQ(mesh.normals[5], Vec3f(0, 0, 1));
}

TEST(MeshNormalsTest, CreasesAboveTheAngle) {
  // Two faces at a right angle, sharing an edge whose vertices are stored twice.
  const std::string text = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 0\nv 1 0 0\nv 0 0 1\nf 1 2 3\nf 5 4 6\n";
  MeshReadOptions options;
  options.max_smooth_angle_degrees = 91;
  const Mesh smooth = obj(text, options);
  options.max_smooth_angle_degrees = 89;
  const Mesh creased = obj(text, options);
  const float h = std::sqrt(0.5f);
  const auto normal_at = [](const Mesh& mesh, size_t triangle, int corner) {
    return mesh.normals[mesh.triangles[triangle][corner]];
  };
  EXPECT_NEAR(glm::length(normal_at(smooth, 0, 0) - Vec3f(0, h, h)), 0.0f, 1e-6f);
  EXPECT_EQ(normal_at(smooth, 0, 2), Vec3f(0, 0, 1));
  EXPECT_EQ(normal_at(creased, 0, 0), Vec3f(0, 0, 1));
  EXPECT_EQ(normal_at(creased, 1, 0), Vec3f(0, 1, 0));
}

}  // namespace
}  // namespace fogbank::scene::test
