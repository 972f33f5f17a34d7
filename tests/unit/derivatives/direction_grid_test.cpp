// The direction grid covers the sphere once, with cells of equal area.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <numbers>

#include "derivatives/direction_grid.h"
#include "derivatives/triangle_form_factor.h"

namespace fogbank::derivatives {
namespace {

TEST(DirectionGrid, MapHasEqualAreasAndCoversTheSphere) {
  // |d dir / da x d dir / db| of an equal-area map of a square of area 4 is pi everywhere off the folds.
  constexpr double h = 1e-6;
  for (int i = 0; i < 12; ++i) {
    for (int j = 0; j < 11; ++j) {
      const double a = -0.93 + 0.17 * i;
      const double b = -0.96 + 0.19 * j;
      const Vec3d da = (octahedral_direction(a + h, b) - octahedral_direction(a - h, b)) / (2 * h);
      const Vec3d db = (octahedral_direction(a, b + h) - octahedral_direction(a, b - h)) / (2 * h);
      EXPECT_NEAR(glm::dot(glm::cross(da, db), octahedral_direction(a, b)), std::numbers::pi, 1e-5);
      EXPECT_NEAR(glm::length(octahedral_direction(a, b)), 1, 1e-15);
    }
  }
  EXPECT_EQ(octahedral_direction(0, 0), Vec3d(0, 0, 1));
  EXPECT_NEAR(octahedral_direction(1, 1).z, -1, 1e-15);
}

TEST(DirectionGrid, IsAClosedTriangulation) {
  for (const int32_t n : {4, 6, 10, 32}) {
    const auto topology = DirectionTopology::of(n);
    EXPECT_EQ(topology, DirectionTopology::of(n));
    const auto cells = static_cast<size_t>(n * n);
    ASSERT_EQ(topology->size(), cells);
    EXPECT_EQ(topology->triangles().size(), 2 * cells - 4);
    // Every edge has two sides, and Euler's formula holds: V - E + F = 2.
    EXPECT_EQ(topology->edges().size(), 3 * cells - 6);
    for (const DirectionTopology::Edge& edge : topology->edges()) {
      const auto traverses = [&](uint32_t triangle, uint32_t a, uint32_t b) {
        const DirectionTopology::Triangle& t = topology->triangles()[triangle];
        for (size_t i = 0; i < 3; ++i)
          if (t[i] == a && t[(i + 1) % 3] == b) return true;
        return false;
      };
      EXPECT_TRUE(traverses(edge.left, edge.a, edge.b));
      EXPECT_TRUE(traverses(edge.right, edge.b, edge.a));
    }
    std::vector<std::array<uint32_t, 8>> neighbours = topology->neighbours();
    for (uint32_t i = 0; i < cells; ++i) {
      for (const uint32_t j : neighbours[i])
        EXPECT_EQ(std::count(neighbours[i].begin(), neighbours[i].end(), j) > 0,
                  std::count(neighbours[j].begin(), neighbours[j].end(), i) > 0);
    }
  }
}

TEST(DirectionGrid, FormFactorsAddUpToOne) {
  RandomStream random(1, 0, 0, 0);
  for (const int32_t n : {4, 6, 16, 64}) {
    const auto topology = DirectionTopology::of(n);
    const std::vector<Vec3f> directions = stratified_directions(*topology, random);
    Vec3d mean(0);
    for (const Vec3f& direction : directions) {
      EXPECT_NEAR(glm::length(direction), 1, 1e-6f);
      mean += Vec3d(direction) / static_cast<double>(directions.size());
    }
    // Stratified in cells of equal area, the mean direction of the sphere is 0 up to a cell's size over the
    // root of their number.
    EXPECT_LT(glm::length(mean), 2.0 / (n * n));
    double sum = 0;
    int inverted = 0;
    for (const DirectionTopology::Triangle& t : topology->triangles()) {
      const double factor = triangle_form_factor(RelativeTriangle<double>::from_relative(
          Vec3d(directions[t[0]]), Vec3d(directions[t[1]]), Vec3d(directions[t[2]])));
      inverted += factor < 0 ? 1 : 0;
      sum += factor;
    }
    EXPECT_NEAR(sum, 1, 1e-13) << n;
    EXPECT_LE(inverted, static_cast<int>(topology->triangles().size()) / 100);
  }
}

TEST(DirectionGrid, SidesAreEvenAndEnough) {
  EXPECT_EQ(DirectionTopology::side_for(1), 4);
  EXPECT_EQ(DirectionTopology::side_for(16), 4);
  EXPECT_EQ(DirectionTopology::side_for(17), 6);
  EXPECT_EQ(DirectionTopology::side_for(1024), 32);
  EXPECT_EQ(DirectionTopology::side_for(1025), 34);
  EXPECT_EQ(DirectionTopology::side_for(1 << 20), 1024);
}

}  // namespace
}  // namespace fogbank::derivatives
