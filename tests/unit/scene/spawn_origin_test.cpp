// Rays that leave a surface: they never hit what they start on, and never start behind something near.
#include <gtest/gtest.h>

#include "core/random.h"
#include "core/sampling.h"
#include "scene/scene_builders.h"

namespace fogbank::scene::test {
namespace {

/// Sizes of scenes, and how far from the origin they lie in units of their size.
constexpr double scales[] = {1e-6, 1e-3, 1.0, 1e3, 1e6};
constexpr double offsets[] = {0.0, 1.0, 100.0, 1e4};

Vec3d direction_of_offset() { return {0.36, -0.48, 0.8}; }

/// In [-1/2, 1/2]^3, half of them much nearer to the origin.
Vec3f random_point(RandomStream& random) {
  const float x = random.next_float() - 0.5f;
  const float y = random.next_float() - 0.5f;
  const Vec3f p(x, y, random.next_float() - 0.5f);
  return random.next_float() < 0.5f ? p : p * std::pow(10.0f, -4.0f * random.next_float());
}

/// Triangles about the origin: every fourth a sliver up to 1000 times as long as wide, every second through
/// the origin, where a position has hardly any rounding error of its own and that of the vertices counts.
Mesh triangle_soup(int count, RandomStream& random) {
  Mesh mesh;
  for (int i = 0; i < count; ++i) {
    const Vec3f along = square_to_uniform_sphere(random.next_vec2());
    const float length = 0.05f + 1.5f * random.next_float();
    const Vec3f a = i % 2 == 0 ? -0.5f * length * along : random_point(random);
    const Vec3f across = glm::normalize(glm::cross(along, square_to_uniform_sphere(random.next_vec2())));
    const float width = i % 4 == 0 ? length * std::pow(10.0f, -3.0f * random.next_float()) : length;
    const auto first = static_cast<uint32_t>(mesh.positions.size());
    mesh.positions.insert(mesh.positions.end(),
                          {a, a + length * along, a + length * random.next_float() * along + width * across});
    mesh.triangles.push_back({first, first + 1, first + 2});
  }
  return mesh;
}

struct Tally {
  size_t spawned = 0;
  size_t wrong = 0;
};

/// Shoots rays through the scene, and from every hit one more; counts those that hit their own primitive
/// again.
Tally respawn(const Scene& scene, double scale, const Vec3d& offset, int rays, RandomStream& random) {
  Tally tally;
  for (int i = 0; i < rays; ++i) {
    const Vec3f target = random_point(random);
    const Vec3f direction = square_to_uniform_sphere(random.next_vec2());
    Ray ray;
    ray.origin = Vec3f(scale * Vec3d(target - 3.0f * direction) + offset);
    ray.direction = direction;
    Hit hit;
    if (!scene.intersector->intersect(ray, hit)) continue;
    const SurfaceInteraction surface = scene.interaction(ray, hit);
    Ray leaving;
    leaving.direction = square_to_uniform_sphere(random.next_vec2());
    leaving.origin = surface.spawn_origin(leaving.direction);
    Hit next;
    ++tally.spawned;
    if (scene.intersector->intersect(leaving, next) && next.shape == hit.shape &&
        next.primitive == hit.primitive && next.instance == hit.instance)
      ++tally.wrong;
  }
  return tally;
}

class SpawnOriginTest : public ::testing::Test {
 protected:
  void SetUp() override { prepare_render_thread(); }
};

TEST_F(SpawnOriginTest, NeverHitsItsOwnTriangle) {
  RandomStream random(1, 2, 3, 4);
  for (const double scale : scales) {
    for (const double offset : offsets) {
      const Vec3d shift = scale * offset * direction_of_offset();
      Scene scene;
      add_mesh(scene, moved(triangle_soup(200, random), scale, shift));
      build(scene);
      const Tally tally = respawn(scene, scale, shift, 5000, random);
      EXPECT_EQ(tally.wrong, 0u) << "of " << tally.spawned << " at scale " << scale << ", offset " << offset;
      EXPECT_GT(tally.spawned, 1000u);
    }
  }
}

TEST_F(SpawnOriginTest, NeverHitsItsOwnTriangleInAnInstance) {
  RandomStream random(5, 6, 7, 8);
  for (const double scale : scales) {
    for (const double offset : offsets) {
      const Vec3d shift = scale * offset * direction_of_offset();
      Scene scene;
      scene.group_count = 1;
      add_mesh(scene, triangle_soup(200, random), 0);
      // Turned, mirrored, and stretched tenfold along one axis of the group.
      Mat4d to_world(1.0);
      to_world[0] = scale * glm::dvec4(0.6, 0.8, 0, 0);
      to_world[1] = scale * glm::dvec4(-0.08, 0.06, 0, 0);
      to_world[2] = scale * glm::dvec4(0, 0, -1, 0);
      to_world[3] = glm::dvec4(shift, 1.0);
      scene.instances = {{0, to_world}};
      build(scene);
      const Tally tally = respawn(scene, scale, shift, 5000, random);
      EXPECT_EQ(tally.wrong, 0u) << "of " << tally.spawned << " at scale " << scale << ", offset " << offset;
      EXPECT_GT(tally.spawned, 1000u);
    }
  }
}

TEST_F(SpawnOriginTest, RoundShapesAreNotHitFromOutside) {
  RandomStream random(9, 10, 11, 12);
  for (const ShapeKind kind : {ShapeKind::sphere, ShapeKind::disk, ShapeKind::cylinder}) {
    for (const double scale : scales) {
      for (const double offset : offsets) {
        const Vec3d shift = scale * offset * direction_of_offset();
        Mat4d to_world(0.5 * scale);
        to_world[3] = glm::dvec4(shift, 1.0);
        Scene scene;
        add_round_shape(scene, kind, to_world);
        build(scene);
        size_t spawned = 0;
        for (int i = 0; i < 5000; ++i) {
          const Vec3f target = random_point(random);
          const Vec3f direction = square_to_uniform_sphere(random.next_vec2());
          const Ray ray{Vec3f(scale * Vec3d(target - 3.0f * direction) + shift), direction, infinity};
          Hit hit;
          if (!scene.intersector->intersect(ray, hit)) continue;
          const SurfaceInteraction surface = scene.interaction(ray, hit);
          Ray leaving;
          leaving.direction = square_to_uniform_sphere(random.next_vec2());
          leaving.origin = surface.spawn_origin(leaving.direction);
          const float cosine = glm::dot(leaving.direction, surface.geometric_normal);
          Hit next;
          ++spawned;
          const bool hits_again = scene.intersector->intersect(leaving, next);
          if (cosine >= 0 || kind == ShapeKind::disk) {
            EXPECT_FALSE(hits_again) << static_cast<int>(kind) << " " << scale << " " << offset << " "
                                     << cosine;
          } else if (kind == ShapeKind::sphere) {
            // From inside, the far side is one chord away, |cos| times the diameter; the offset and rounding
            // of the start move it by a few errors over |cos|.
            const auto chord = static_cast<double>(-cosine) * scale;
            const double error =
                4 * glm::length(Vec3d(surface.position_error)) / static_cast<double>(-cosine);
            EXPECT_EQ(hits_again, true) << scale << " " << offset << " " << cosine;
            EXPECT_NEAR(next.distance, chord, error + 1e-6 * chord)
                << scale << " " << offset << " " << cosine;
          }
        }
        EXPECT_GT(spawned, 500u);
      }
    }
  }
}

TEST_F(SpawnOriginTest, DoesNotTunnelThroughSomethingNear) {
  // A second sheet 1e-5 of the scene's size above the first must stop every ray that leaves upwards. From 10
  // sizes away the coordinates themselves get too coarse for that (an ulp is 1e-6 of the size).
  RandomStream random(13, 14, 15, 16);
  for (const double scale : scales) {
    for (const double offset : {0.0, 0.5, 2.0}) {
      const Vec3d shift = scale * offset * direction_of_offset();
      Scene scene;
      const uint32_t lower = add_mesh(scene, moved(square(0.0f), 0.5 * scale, shift));
      const uint32_t upper = add_mesh(scene, moved(square(2e-5f), 0.5 * scale, shift));
      build(scene);
      for (int i = 0; i < 2000; ++i) {
        const Vec3f target(0.8f * (random.next_float() - 0.5f), 0.8f * (random.next_float() - 0.5f), 0.0f);
        // From below, so that the lower sheet is hit.
        Vec3f direction = square_to_uniform_sphere(random.next_vec2());
        direction.z = std::fabs(direction.z) + 0.05f;
        direction = glm::normalize(direction);
        const Ray ray{Vec3f(scale * Vec3d(target - direction) + shift), direction, infinity};
        Hit hit;
        ASSERT_TRUE(scene.intersector->intersect(ray, hit));
        ASSERT_EQ(hit.shape, lower);
        const SurfaceInteraction surface = scene.interaction(ray, hit);
        Vec3f leaving_direction = square_to_cosine_hemisphere(random.next_vec2());
        // So steep that the ray meets the upper sheet before its edge.
        leaving_direction.z += 0.01f;
        const Ray leaving{surface.spawn_origin(leaving_direction), glm::normalize(leaving_direction),
                          infinity};
        Hit next;
        ASSERT_TRUE(scene.intersector->intersect(leaving, next)) << scale << " " << offset;
        EXPECT_EQ(next.shape, upper) << scale << " " << offset;
      }
    }
  }
}

TEST_F(SpawnOriginTest, ErrorBoundsHoldForTheRayThatHit) {
  // The reported position lies on the ray within its own error plus that of the distance: Embree's plane test
  // rounds vertices relative to the ray's origin, so a few ulps of the way, divided by the angle of
  // incidence. Slivers (every fourth), whose planes are less certain, are left out.
  RandomStream random(17, 18, 19, 20);
  Scene scene;
  add_mesh(scene, triangle_soup(200, random));
  build(scene);
  for (int i = 0; i < 5000; ++i) {
    const Vec3f direction = square_to_uniform_sphere(random.next_vec2());
    const Ray ray{random_point(random) - 3.0f * direction, direction, infinity};
    Hit hit;
    if (!scene.intersector->intersect(ray, hit) || hit.primitive % 4 == 0) continue;
    const SurfaceInteraction surface = scene.interaction(ray, hit);
    const double cosine = std::fabs(static_cast<double>(glm::dot(direction, surface.geometric_normal)));
    const Vec3d along = Vec3d(ray.origin) + static_cast<double>(hit.distance) * Vec3d(direction);
    const double distance = glm::length(along - Vec3d(surface.position));
    const double position_error = glm::length(Vec3d(surface.position_error));
    EXPECT_LE(distance, (4 * position_error + 0x1p-21 * static_cast<double>(hit.distance)) / cosine) << i;
  }
}

}  // namespace
}  // namespace fogbank::scene::test
