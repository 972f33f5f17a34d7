// Round shapes, placed and instanced: what a ray sees agrees with Mitsuba 3.9.1.
#include <gtest/gtest.h>

#include <glm/gtc/constants.hpp>

#include "core/random.h"
#include "core/sampling.h"
#include "scene/round_shape.h"
#include "scene/round_shapes_expected.h"
#include "scene/scene_builders.h"

namespace fogbank::scene::test {
namespace {

TEST(RoundShapesTest, AgreeWithMitsuba) {
  prepare_render_thread();
  for (const Expected& expected : table) {
    SCOPED_TRACE(::testing::Message() << "row " << (&expected - table));
    Scene scene;
    const Mat4d placement = placed(expected.placement);
    add_round_shape(scene, expected.kind, expected.is_instance ? Mat4d(1.0) : placement,
                    expected.is_instance ? 0 : none);
    scene.shapes[0].flip_normals = expected.flip_normals;
    if (expected.is_instance) {
      scene.group_count = 1;
      scene.instances = {{0, placement}};
    }
    build(scene);
    const Ray ray{expected.origin, expected.direction, infinity};
    Hit hit;
    ASSERT_TRUE(scene.intersector->intersect(ray, hit));
    EXPECT_EQ(hit.instance, expected.is_instance ? 0 : none);
    const SurfaceInteraction surface = scene.interaction(ray, hit);
    // Mitsuba works in single precision at coordinates up to 10 and was printed with six digits.
    constexpr float tolerance = 2e-5f;
    EXPECT_NEAR(surface.distance, expected.distance, tolerance);
    EXPECT_NEAR(glm::distance(surface.position, ray.at(expected.distance)), 0.0f, 2 * tolerance);
    EXPECT_NEAR(surface.uv.x, expected.uv.x, tolerance);
    EXPECT_NEAR(surface.uv.y, expected.uv.y, tolerance);
    for (int axis = 0; axis < 3; ++axis) {
      EXPECT_NEAR(surface.geometric_normal[axis], expected.normal[axis], tolerance) << axis;
      EXPECT_EQ(surface.shading_normal[axis], surface.geometric_normal[axis]) << axis;
      EXPECT_NEAR(surface.dp_du[axis], expected.dp_du[axis], 10 * tolerance) << axis;
      EXPECT_NEAR(surface.dp_dv[axis], expected.dp_dv[axis], 10 * tolerance) << axis;
    }
  }
}

TEST(RoundShapesTest, DerivativesAreThoseOfTheSurface) {
  // p(u, v) of the parametrisation, differentiated numerically.
  const auto point = [](ShapeKind kind, double u, double v) {
    const double two_pi = 2.0 * glm::pi<double>();
    switch (kind) {
      case ShapeKind::disk:
        return Vec3d(u * std::cos(two_pi * v), u * std::sin(two_pi * v), 0.0);
      case ShapeKind::cylinder:
        return Vec3d(std::cos(two_pi * u), std::sin(two_pi * u), v);
      default:
        return Vec3d(std::sin(two_pi / 2 * v) * std::cos(two_pi * u),
                     std::sin(two_pi / 2 * v) * std::sin(two_pi * u), std::cos(two_pi / 2 * v));
    }
  };
  RandomStream random(41, 42, 43, 44);
  for (const ShapeKind kind : {ShapeKind::sphere, ShapeKind::disk, ShapeKind::cylinder}) {
    for (int i = 0; i < 100; ++i) {
      const double u = 0.01 + 0.98 * static_cast<double>(random.next_float());
      const double v = 0.01 + 0.98 * static_cast<double>(random.next_float());
      const RoundShapePoint at = round_shape_point(kind, point(kind, u, v));
      EXPECT_NEAR(at.uv.x, u, 1e-12);
      EXPECT_NEAR(at.uv.y, v, 1e-12);
      constexpr double h =
          1e-5;  // error of a central difference: h^2 times a third derivative, about 250 h^2
      const Vec3d along_u = (point(kind, u + h, v) - point(kind, u - h, v)) / (2 * h);
      const Vec3d along_v = (point(kind, u, v + h) - point(kind, u, v - h)) / (2 * h);
      EXPECT_LT(glm::length(at.dp_du - along_u), 1e-7);
      EXPECT_LT(glm::length(at.dp_dv - along_v), 1e-7);
    }
  }
}

TEST(RoundShapesTest, PolesAndAxesAreFinite) {
  for (const ShapeKind kind : {ShapeKind::sphere, ShapeKind::disk}) {
    for (const double z : {1.0, -1.0}) {
      const RoundShapePoint pole = round_shape_point(kind, {0, 0, z});
      EXPECT_GT(glm::length(pole.dp_du), 0.0);
      EXPECT_GT(glm::length(pole.dp_dv), 0.0);
      EXPECT_TRUE(std::isfinite(pole.uv.x) && std::isfinite(pole.uv.y));
    }
  }
}

TEST(RoundShapesTest, BoundsHoldThePoints) {
  RandomStream random(45, 46, 47, 48);
  for (const ShapeKind kind : {ShapeKind::sphere, ShapeKind::disk, ShapeKind::cylinder}) {
    for (const Placement placement : {Placement::similar, Placement::stretched, Placement::mirrored}) {
      Vec3f lower;
      Vec3f upper;
      RoundShape(kind, placed(placement)).bounds(lower, upper);
      Vec3d least(1e9);
      Vec3d most(-1e9);
      for (int i = 0; i < 20'000; ++i) {
        Vec3d local(square_to_uniform_sphere(random.next_vec2()));
        if (kind != ShapeKind::sphere) {
          const Vec2d around = glm::normalize(Vec2d(local));
          local = {around, kind == ShapeKind::disk ? 0.0 : static_cast<double>(i % 2)};
        }
        const Vec3d p(placed(placement) * glm::dvec4(local, 1.0));
        least = glm::min(least, p);
        most = glm::max(most, p);
      }
      for (int axis = 0; axis < 3; ++axis) {
        EXPECT_LE(lower[axis], least[axis]);
        EXPECT_GE(upper[axis], most[axis]);
        // Not loose either: the densest of 20 000 points comes within 1 % of the extreme.
        EXPECT_NEAR(lower[axis], least[axis], 0.03);
        EXPECT_NEAR(upper[axis], most[axis], 0.03);
      }
    }
  }
}

TEST(RoundShapesTest, FarSpheresKeepTheirSilhouette) {
  // A unit sphere seen from 10^5 away: the ray's distance from the centre decides, to a part in 10^6.
  Scene scene;
  add_round_shape(scene, ShapeKind::sphere, Mat4d(1.0));
  build(scene);
  Hit hit;
  for (const float miss : {0.5f, 0.999f, 0.999999f})
    EXPECT_TRUE(scene.intersector->intersect({{miss, 0, 1e5f}, {0, 0, -1}, infinity}, hit)) << miss;
  for (const float miss : {1.000001f, 1.001f})
    EXPECT_FALSE(scene.intersector->intersect({{miss, 0, 1e5f}, {0, 0, -1}, infinity}, hit)) << miss;
}

TEST(RoundShapesTest, CylindersHaveOpenEnds) {
  Scene scene;
  add_round_shape(scene, ShapeKind::cylinder, Mat4d(1.0));
  build(scene);
  Hit hit;
  EXPECT_FALSE(scene.intersector->intersect({{0.2f, 0.1f, 5}, {0, 0, -1}, infinity}, hit));
  EXPECT_FALSE(scene.intersector->intersect({{5, 0, 1.01f}, {-1, 0, 0}, infinity}, hit));
  // In by the open end, out to the inside of the far wall.
  const Ray slanted{{-3, 0, 2}, glm::normalize(Vec3f(4, 0, -1.5f)), infinity};
  ASSERT_TRUE(scene.intersector->intersect(slanted, hit));
  EXPECT_NEAR(scene.interaction(slanted, hit).position.x, 1.0f, 1e-6f);
}

}  // namespace
}  // namespace fogbank::scene::test
