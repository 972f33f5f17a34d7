// Cameras that a job moves away from where the scene file has them: the medium that their rays start in.
#include <gtest/gtest.h>

#include "function_integrator.h"
#include "render/job_integrator.h"
#include "scene/intersector.h"
#include "transport/world_builders.h"

namespace fogbank::render {
namespace {

using transport::test::parse_world;

constexpr int32_t fog = 0;
constexpr int32_t smoke = 1;

/// A ball of fog of radius 2 with a ball of smoke of radius 1 and a cube that bounds no medium inside, seen
/// from `origin` in `medium` (what to write into the sensor). Near clip plane at 0.01.
std::shared_ptr<const transport::World> balls(const std::string& origin, const std::string& medium) {
  return parse_world(R"(
    <medium type="homogeneous" id="fog"><rgb name="sigma_t" value="0.6"/><rgb name="albedo" value="0.8"/></medium>
    <medium type="homogeneous" id="smoke"><rgb name="sigma_t" value="3"/><rgb name="albedo" value="0.5"/></medium>
    <sensor type="perspective"><float name="fov" value="50"/>
      <transform name="to_world"><lookat origin=")" +
                     origin + R"(" target="0, 0, 0" up="0, 1, 0"/></transform>)" + medium + R"(</sensor>
    <shape type="sphere"><float name="radius" value="2"/><bsdf type="null"/>
      <ref name="interior" id="fog"/></shape>
    <shape type="sphere"><bsdf type="null"/><ref name="interior" id="smoke"/>
      <ref name="exterior" id="fog"/></shape>
    <shape type="cube"><transform name="to_world"><scale value="0.3"/><translate x="1.5"/></transform></shape>
    <emitter type="constant"><rgb name="radiance" value="1, 2, 3"/></emitter>)");
}

/// At `origin`, looking at `target`; y is up.
scene::Sensor moved(const transport::World& world, const Vec3d& origin, const Vec3d& target) {
  scene::Sensor sensor = world.scene().sensor;
  const Vec3d forward = glm::normalize(target - origin);
  const Vec3d left = glm::normalize(glm::cross(Vec3d(0, 1, 0), forward));
  sensor.to_world[0] = {left, 0};
  sensor.to_world[1] = {glm::cross(forward, left), 0};
  sensor.to_world[2] = {forward, 0};
  sensor.to_world[3] = {origin, 1};
  return sensor;
}

TEST(MovedCamera, IsInTheMediumAtItsPlace) {
  const auto world = balls("0, 0, -5", "");
  const auto medium = [&](const Vec3d& origin, const Vec3d& target) {
    return camera_medium(*world, moved(*world, origin, target));
  };
  EXPECT_EQ(medium({0, 0, -4}, {0, 0, 0}), scene::none);
  EXPECT_EQ(medium({0, 0, -1.5}, {0, 0, 0}), fog);
  EXPECT_EQ(medium({0, 0.1, -0.5}, {0, 0, 0}), smoke);
  EXPECT_EQ(medium({1.5, 0.05, 0.02}, {0, 0, 0}), fog) << "inside an object that bounds no medium";
  EXPECT_EQ(medium({300, 20, 10}, {0, 0, 0}), scene::none);
}

TEST(MovedCamera, OnABoundaryLooksIntoOneSide) {
  const auto world = balls("0, 0, -5", "");
  EXPECT_EQ(camera_medium(*world, moved(*world, {0, 0, -2}, {0, 0, 0})), fog);
  EXPECT_EQ(camera_medium(*world, moved(*world, {0, 0, -2}, {0, 0, -9})), scene::none);
  EXPECT_EQ(camera_medium(*world, moved(*world, {0, 0, -1}, {0, 0, 0})), smoke);
  EXPECT_EQ(camera_medium(*world, moved(*world, {0, 0, -1}, {0, 0, -9})), fog);
}

TEST(MovedCamera, AFilesOwnCameraIsWhereTheFileSays) {
  const auto inside = balls("0, 0, -1.5", R"(<ref name="medium" id="fog"/>)");
  EXPECT_EQ(camera_medium(*inside, inside->scene().sensor), fog);
  // As in Mitsuba: the file's word counts, even where it is wrong.
  const auto wrong = balls("0, 0, -1.5", "");
  EXPECT_EQ(camera_medium(*wrong, wrong->scene().sensor), scene::none);
}

TEST(MovedCamera, WithoutBoundariesFogIsEverywhere) {
  const auto world = parse_world(R"(
    <medium type="homogeneous" id="fog"><rgb name="sigma_t" value="1"/><rgb name="albedo" value="0"/></medium>
    <sensor type="perspective"><ref name="medium" id="fog"/></sensor><shape type="sphere"/>)");
  EXPECT_EQ(camera_medium(*world, moved(*world, {9, 0, 0}, {0, 0, 0})), fog);
}

Image picture(const std::shared_ptr<const transport::World>& world, const std::string& integrator,
              const scene::Sensor& sensor) {
  RenderSettings settings = small_settings(8, 6, 1);
  settings.integrator = integrator;
  settings.sensor = sensor;
  RenderJob job(world, settings);
  run_to_completion(job, 2);
  return job.image();
}

TEST(MovedCamera, SeesWhatTheFilesCameraSeesThere) {
  // The places of the second scene's own camera; the first one's is out in the vacuum.
  const auto from_outside = balls("0, 0, -5", "");
  for (const std::string integrator :
       {"volpath", "photon-beams", "radiance-cache", "radiance-cache-unaware"}) {
    SCOPED_TRACE(integrator);
    const auto from_fog = balls("0, 0.5, -1.5", R"(<ref name="medium" id="fog"/>)");
    const Image moved_there = picture(from_outside, integrator, from_fog->scene().sensor);
    EXPECT_EQ(moved_there.rgb, picture(from_fog, integrator, from_fog->scene().sensor).rgb);
    const auto from_smoke = balls("0, 0.5, -0.5", R"(<ref name="medium" id="smoke"/>)");
    EXPECT_EQ(picture(from_fog, integrator, from_smoke->scene().sensor).rgb,
              picture(from_smoke, integrator, from_smoke->scene().sensor).rgb);
    EXPECT_EQ(picture(from_smoke, integrator, from_outside->scene().sensor).rgb,
              picture(from_outside, integrator, from_outside->scene().sensor).rgb);
  }
}

}  // namespace
}  // namespace fogbank::render
