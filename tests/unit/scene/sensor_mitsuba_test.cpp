// Camera rays against Mitsuba 3.9.1, for every kind of camera, `fov_axis`, crop window and lens.
#include <gtest/gtest.h>

#include "scene/mitsuba_sensor_rays.h"
#include "scene/scene_builder.h"
#include "scene/scene_file_reader.h"
#include "scene/scene_files.h"
#include "scene/sensor_reader.h"
#include "scene/xml/parser.h"

namespace fogbank::scene::test {
namespace {

TEST(SensorAgainstMitsuba, Rays) {
  for (const MitsubaSensorRay& expected : mitsuba_sensor_rays) {
    SCOPED_TRACE(expected.sensor);
    TemporaryFolder folder;
    folder.write("scene.xml", std::string("<scene version='3.0.0'>") + expected.sensor + "</scene>");
    const auto files = folder.source();
    const ParsedScene parsed = parse_scene("scene.xml", *files, {});
    Scene scene;
    const auto reader = read_in_process(files);
    SceneBuilder builder(scene, *reader);
    read_sensor(*parsed.objects.at(0), builder);

    const Window& crop = scene.film.crop;
    const Vec2f position(static_cast<float>(crop.x) + expected.position.x * static_cast<float>(crop.width),
                         static_cast<float>(crop.y) + expected.position.y * static_cast<float>(crop.height));
    const Ray ray = scene.sensor.sample_ray(scene.film, position, expected.lens);
    // Mitsuba works in single precision: its projection matrix alone loses a few of the 24 bits.
    constexpr float tolerance = 4e-6f;
    for (int axis = 0; axis < 3; ++axis) {
      EXPECT_NEAR(ray.direction[axis], expected.direction[axis], tolerance);
      EXPECT_NEAR(ray.origin[axis], expected.origin[axis], tolerance * 4);
    }
    EXPECT_NEAR(ray.max_distance, expected.max_distance, 2e-5f * expected.max_distance);
    EXPECT_NEAR(glm::length(ray.direction), 1.0f, 2e-7f);
  }
}

}  // namespace
}  // namespace fogbank::scene::test
