// Ray queries: which surfaces they see.
#include <gtest/gtest.h>

#include "scene/scene_builders.h"

namespace fogbank::scene::test {
namespace {

Ray down(float x, float y, float z, float max_distance = infinity) {
  return {{x, y, z}, {0, 0, -1}, max_distance};
}

class IntersectorTest : public ::testing::Test {
 protected:
  void SetUp() override { prepare_render_thread(); }
};

TEST_F(IntersectorTest, EmptySceneHasNoHits) {
  Scene scene;
  build(scene);
  Hit hit;
  EXPECT_FALSE(scene.intersector->intersect(down(0, 0, 1), hit));
  EXPECT_FALSE(scene.intersector->occluded(down(0, 0, 1)));
  EXPECT_FALSE(scene.intersector->has_passing_surfaces());
  EXPECT_FALSE(scene.intersector->intersect_passing(down(0, 0, 1), hit));
}

TEST_F(IntersectorTest, NearestOfSeveralShapes) {
  Scene scene;
  add_mesh(scene, square(0));
  const uint32_t upper = add_mesh(scene, square(1));
  build(scene);
  Hit hit;
  ASSERT_TRUE(scene.intersector->intersect(down(0.5f, 0.25f, 3), hit));
  EXPECT_EQ(hit.shape, upper);
  EXPECT_EQ(hit.distance, 2.0f);
  EXPECT_EQ(hit.instance, none);
  EXPECT_GT(scene.intersector->memory_bytes(), 0u);
  EXPECT_GE(scene.intersector->build_seconds(), 0.0);
}

TEST_F(IntersectorTest, IntervalIsOpenAtBothEnds) {
  Scene scene;
  add_mesh(scene, square(0));
  add_round_shape(scene, ShapeKind::disk, translation({10, 0, 0}));
  build(scene);
  for (const float x : {0.5f, 10.5f}) {
    Hit hit;
    EXPECT_FALSE(scene.intersector->intersect(down(x, 0.25f, 0), hit)) << x;
    EXPECT_FALSE(scene.intersector->intersect(down(x, 0.25f, 2, 2), hit)) << x;
    EXPECT_FALSE(scene.intersector->occluded(down(x, 0.25f, 2, 2))) << x;
    const float beyond = std::nextafter(2.0f, 3.0f);
    EXPECT_TRUE(scene.intersector->intersect(down(x, 0.25f, 2, beyond), hit)) << x;
    EXPECT_TRUE(scene.intersector->occluded(down(x, 0.25f, 2, beyond))) << x;
    EXPECT_FALSE(scene.intersector->intersect(down(x, 0.25f, 2, 0), hit)) << x;
    EXPECT_FALSE(scene.intersector->occluded(down(x, 0.25f, 2, -1))) << x;
  }
}

TEST_F(IntersectorTest, PassingSurfacesDoNotOcclude) {
  Scene scene;
  const uint32_t solid = add_mesh(scene, square(0));
  const uint32_t veil = add_mesh(scene, square(1));
  const uint32_t bubble = add_round_shape(scene, ShapeKind::sphere, translation({0, 0, 4}));
  scene.shapes[veil].passes_light = true;
  scene.shapes[bubble].passes_light = true;
  build(scene);
  EXPECT_TRUE(scene.intersector->has_passing_surfaces());

  Hit hit;
  ASSERT_TRUE(scene.intersector->intersect(down(0.1f, 0.2f, 8), hit));
  EXPECT_EQ(hit.shape, bubble);
  ASSERT_TRUE(scene.intersector->intersect(down(0.1f, 0.2f, 2), hit));
  EXPECT_EQ(hit.shape, veil);
  ASSERT_TRUE(scene.intersector->intersect_passing(down(0.1f, 0.2f, 2), hit));
  EXPECT_EQ(hit.shape, veil);
  ASSERT_TRUE(scene.intersector->intersect(down(0.1f, 0.2f, 0.5f), hit));
  EXPECT_EQ(hit.shape, solid);
  EXPECT_FALSE(scene.intersector->intersect_passing(down(0.1f, 0.2f, 0.5f), hit));

  EXPECT_FALSE(scene.intersector->occluded(down(0.1f, 0.2f, 8, 7.5f)));
  EXPECT_TRUE(scene.intersector->occluded(down(0.1f, 0.2f, 8)));
}

TEST_F(IntersectorTest, GroupsAreSeenThroughInstancesOnly) {
  Scene scene;
  scene.group_count = 2;
  add_mesh(scene, square(-50));
  const uint32_t solid = add_mesh(scene, square(0), 1);
  const uint32_t veil = add_round_shape(scene, ShapeKind::disk, translation({0, 0, 1}), 1);
  scene.shapes[veil].passes_light = true;
  scene.instances = {{0, translation({0, 0, 0})}, {1, translation({5, 0, 0})}, {1, translation({9, 0, 2})}};
  build(scene);
  EXPECT_TRUE(scene.intersector->has_passing_surfaces());

  Hit hit;
  EXPECT_FALSE(scene.intersector->intersect(down(0.1f, 0.2f, 8, 20), hit));
  ASSERT_TRUE(scene.intersector->intersect(down(5.1f, 0.2f, 8), hit));
  EXPECT_EQ(hit.shape, veil);
  EXPECT_EQ(hit.instance, 1);
  EXPECT_EQ(hit.distance, 7.0f);
  ASSERT_TRUE(scene.intersector->intersect(down(9.1f, 0.2f, 2.5f), hit));
  EXPECT_EQ(hit.shape, solid);
  EXPECT_EQ(hit.instance, 2);
  ASSERT_TRUE(scene.intersector->intersect_passing(down(9.1f, 0.2f, 8), hit));
  EXPECT_EQ(hit.shape, veil);
  EXPECT_EQ(hit.instance, 2);
  EXPECT_FALSE(scene.intersector->occluded(down(9.1f, 0.2f, 8, 5.5f)));
  EXPECT_TRUE(scene.intersector->occluded(down(9.1f, 0.2f, 8, 6.5f)));
}

}  // namespace
}  // namespace fogbank::scene::test
