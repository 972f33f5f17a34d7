// Furnaces: scenes in which every ray carries a radiance of 1, whatever lies on its way, seen through a cache
// that was empty. The unaware cache doesn't hold this: it is up to a third too bright behind the plate.
#include <gtest/gtest.h>

#include <cmath>

#include "cache/scene_cache.h"
#include "integrators/picture.h"
#include "transport/world_builders.h"

namespace fogbank::integrators {
namespace {

using test::Picture;
using test::TestCamera;

std::string fog_of_albedo_1(const std::string& sigma_t) {
  return R"(<medium type="homogeneous" id="fog"><rgb name="sigma_t" value=")" + sigma_t +
         R"("/><rgb name="albedo" value="1"/></medium>)";
}

constexpr const char* sensor_in_fog = R"(
  <sensor type="perspective"><float name="fov" value="70"/><ref name="medium" id="fog"/>
    <transform name="to_world"><lookat origin="0.1, -0.9, 0.1" target="0, 0, 0" up="0, 0, 1"/></transform></sensor>)";

/// A box whose walls send out 1 - reflectance and reflect the rest of the light of 1 that they get, full of
/// fog that absorbs nothing, with a white plate in it.
const std::string closed_box = fog_of_albedo_1("0.1, 0.2, 0.3") + sensor_in_fog + R"(
  <shape type="cube">
    <boolean name="flip_normals" value="true"/>
    <bsdf type="diffuse"><rgb name="reflectance" value="0.4, 0.3, 0.2"/></bsdf>
    <emitter type="area"><rgb name="radiance" value="0.6, 0.7, 0.8"/></emitter>
  </shape>
  <shape type="rectangle"><transform name="to_world"><scale value="0.3"/></transform>
    <bsdf type="twosided"><bsdf type="diffuse"><rgb name="reflectance" value="1"/></bsdf></bsdf></shape>)";

/// A ball of that fog under a sky of 1, with a white plate and a mirror in it.
const std::string white_sky = fog_of_albedo_1("0.5, 0.8, 1.2") + R"(
  <sensor type="perspective"><float name="fov" value="40"/>
    <transform name="to_world"><lookat origin="0.3, -4, 0.2" target="0, 0, 0" up="0, 0, 1"/></transform></sensor>
  <shape type="sphere"><bsdf type="null"/><ref name="interior" id="fog"/></shape>
  <shape type="rectangle"><transform name="to_world"><scale value="0.5"/><translate z="-0.2"/></transform>
    <bsdf type="twosided"><bsdf type="diffuse"><rgb name="reflectance" value="1"/></bsdf></bsdf></shape>
  <shape type="sphere"><float name="radius" value="0.2"/><point name="center" x="0.3" y="0" z="0.3"/>
    <bsdf type="conductor"><string name="material" value="none"/></bsdf></shape>
  <emitter type="constant"><rgb name="radiance" value="1"/></emitter>)";

class Furnaces : public testing::TestWithParam<std::string> {};

TEST_P(Furnaces, EveryPartOfThePictureIsOne) {
  const auto world = transport::test::parse_world(GetParam());
  // Extents are 1.5 pixels at least, which must not be much beside a mean free path.
  constexpr uint32_t side = 16;
  constexpr uint32_t block = 4;
  constexpr double pixels = block * block;  // of a block
  constexpr double blocks = side * side / pixels;
  const TestCamera camera(world->scene().sensor, side, side);
  IntegratorSettings settings;
  settings.rr_depth = 16;
  settings.most_records =
      24;  // most of them the pilot's; they are dear here, and paths take the place of others
  settings.cache = std::make_shared<cache::SceneCache>();
  const auto integrator = make_integrator("radiance-cache", world, settings);
  constexpr double target = 0.1;
  prepare(*integrator, camera, {.error = target}, 2);
  ASSERT_GT(integrator->cache_counts().records_new, 0u);
  const Picture picture = take(*integrator, camera, 8, 2);
  Vec3d whole(0);
  for (uint32_t y = 0; y < side; y += block)
    for (uint32_t x = 0; x < side; x += block) {
      Vec3d mean(0);
      double variance = 0;
      for (uint32_t i = 0; i < block * block; ++i) {
        const size_t pixel = size_t{y + i / block} * side + x + i % block;
        mean += Vec3d(picture.mean[pixel]) / pixels;
        variance += picture.variance[pixel] / (pixels * pixels);
      }
      // What the cache may err by, and noise of paths: 5 standard errors, 1 chance in 10,000 for all blocks.
      const double allowed = target + 5 * std::sqrt(variance);
      for (int channel = 0; channel < 3; ++channel)
        EXPECT_NEAR(mean[channel], 1, allowed) << x << ", " << y << ", " << channel;
      whole += mean / blocks;
    }
  // No energy comes from nowhere, or is lost: errors of records partly cancel.
  for (int channel = 0; channel < 3; ++channel) EXPECT_NEAR(whole[channel], 1, 0.5 * target) << channel;
}

INSTANTIATE_TEST_SUITE_P(All, Furnaces, testing::Values(closed_box, white_sky), [](const auto& furnace) {
  return furnace.param == closed_box ? "closed_box" : "white_sky";
});

}  // namespace
}  // namespace fogbank::integrators
