// World::medium_at on the project's scenes and on small ones whose answer is known.
#include <gtest/gtest.h>

#include <filesystem>
#include <memory>

#include "scene/shared_data.h"
#include "transport/world.h"
#include "transport/world_builders.h"

namespace fogbank::transport {
namespace {

using test::load_world;
using test::parse_world;

const std::string two_media = R"(
  <medium type="homogeneous" id="fog"><rgb name="sigma_t" value="1"/><rgb name="albedo" value="0.5"/></medium>
  <medium type="homogeneous" id="smoke"><rgb name="sigma_t" value="2"/><rgb name="albedo" value="0.5"/></medium>)";

TEST(MediumAt, PenumbraIsFogUpToTheBox) {
  const auto world = load_world("scenes/penumbra", "penumbra.xml");
  const int32_t fog = world->scene().sensor.medium;
  ASSERT_NE(fog, scene::none);
  for (const Vec3f x : {Vec3f(0), Vec3f(2.9f, 3.1f, 1.9f), Vec3f(-0.55f, 0, 0.99f), Vec3f(0, 0, 1.99f)})
    EXPECT_EQ(world->medium_at(x), fog) << x.x;
  // Between the room's walls and the box of the fog: walls bound no medium.
  EXPECT_EQ(world->medium_at({3.1f, 0, 0.5f}), fog);
  for (const Vec3f x : {Vec3f(3.21f, 0, 0.5f), Vec3f(0, 100, 0), Vec3f(-1e6f, 2e6f, 1e5f)})
    EXPECT_EQ(world->medium_at(x), scene::none) << x.x;
}

TEST(MediumAt, CloudOfGlowIsAMesh) {
  const auto world = load_world("scenes/glow", "glow.xml");
  EXPECT_EQ(world->medium_at({0, 0, 0}), 0);
  EXPECT_EQ(world->medium_at({0.28f, 0.15f, -0.05f}), 0);  // between lamp and cage
  for (const Vec3f x :
       {Vec3f(1.1f, 1.25f, 3.7f), Vec3f(0, -0.69f, 1.5f), Vec3f(0, 4, 0), Vec3f(0, -0.75f, 0)})
    EXPECT_EQ(world->medium_at(x), scene::none) << x.x;
}

TEST(MediumAt, StatuesStandInFog) {
  const std::string root = fogbank::test::shared_path("data/statues");
  if (!std::filesystem::exists(root)) GTEST_SKIP() << "shared data is absent: " << root;
  const auto world = load_world(root, "room_fog.xml");
  const int32_t fog = world->scene().sensor.medium;
  EXPECT_EQ(world->medium_at({9.5f, 1.9f, 5.3f}), fog);
  EXPECT_EQ(world->medium_at({2.6f, 3.0f, 4.2f}), fog);
  EXPECT_EQ(world->medium_at({4.6f, 0.4f, 2.5f}), fog);
  EXPECT_EQ(world->medium_at({5, 5, 3}), scene::none);
}

TEST(MediumAt, WithoutBoundariesTheSensorsDecides) {
  EXPECT_EQ(parse_world(two_media + R"(<sensor type="perspective"><ref name="medium" id="smoke"/></sensor>
      <shape type="sphere"/>)")
                ->medium_at({5, 0, 0}),
            1);
  EXPECT_EQ(parse_world(two_media + R"(<shape type="sphere"/>)")->medium_at({5, 0, 0}), scene::none);
}

TEST(MediumAt, NestedAndExteriorMedia) {
  const auto world = parse_world(two_media + R"(
    <shape type="sphere"><float name="radius" value="3"/><bsdf type="null"/><ref name="interior" id="fog"/></shape>
    <shape type="sphere"><bsdf type="null"/><ref name="interior" id="smoke"/><ref name="exterior" id="fog"/></shape>
    <shape type="cube"><transform name="to_world"><scale value="0.2"/><translate x="2"/></transform>
      <ref name="exterior" id="fog"/></shape>)");
  EXPECT_EQ(world->medium_at({0, 0, 0}), 1);
  EXPECT_EQ(world->medium_at({0, 1.5f, 0}), 0);
  EXPECT_EQ(world->medium_at({0, 3.1f, 0}), scene::none);
  EXPECT_EQ(world->medium_at({2, 0, 0}), scene::none) << "inside an object that says what is outside it";
  EXPECT_EQ(world->medium_at({1.7f, 0, 0}), 0);
}

TEST(MediumAt, FarFromASmallBoundaryRaysAreAimedAtIt) {
  // The camera is inside the small ball, so the sensor's medium would be the wrong answer out here.
  const auto world =
      parse_world(two_media + R"(<sensor type="perspective"><ref name="medium" id="fog"/></sensor>
    <shape type="sphere"><float name="radius" value="0.01"/><bsdf type="null"/><ref name="interior" id="fog"/></shape>)");
  EXPECT_EQ(world->medium_at({100, 20, 3}), scene::none);
  EXPECT_EQ(world->medium_at({0.001f, 0, 0}), 0);
}

}  // namespace
}  // namespace fogbank::transport
