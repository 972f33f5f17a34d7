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

struct Camera {
  Sensor sensor;
  Film film;
};

Camera read_camera(const std::string& text) {
  TemporaryFolder folder;
  folder.write("scene.xml", "<scene version='3.0.0'>" + text + "</scene>");
  const auto files = folder.source();
  const ParsedScene parsed = parse_scene("scene.xml", *files, {});
  Scene scene;
  const auto reader = read_in_process(files);
  SceneBuilder builder(scene, *reader);
  read_sensor(*parsed.objects.at(0), builder);
  return {scene.sensor, scene.film};
}

void expect_ray(const Sensor& sensor, const Film& film, const MitsubaSensorRay& expected) {
  const Window& crop = film.crop;
  const Vec2f position(static_cast<float>(crop.x) + expected.position.x * static_cast<float>(crop.width),
                       static_cast<float>(crop.y) + expected.position.y * static_cast<float>(crop.height));
  const Ray ray = sensor.sample_ray(film, position, expected.lens);
  // Mitsuba works in single precision: its projection matrix alone loses a few of the 24 bits.
  constexpr float tolerance = 4e-6f;
  for (int axis = 0; axis < 3; ++axis) {
    EXPECT_NEAR(ray.direction[axis], expected.direction[axis], tolerance);
    EXPECT_NEAR(ray.origin[axis], expected.origin[axis], tolerance * 4);
  }
  EXPECT_NEAR(ray.max_distance, expected.max_distance, 2e-5f * expected.max_distance);
  EXPECT_NEAR(glm::length(ray.direction), 1.0f, 2e-7f);
}

TEST(SensorAgainstMitsuba, Rays) {
  for (const MitsubaSensorRay& expected : mitsuba_sensor_rays) {
    SCOPED_TRACE(expected.sensor);
    const Camera camera = read_camera(expected.sensor);
    expect_ray(camera.sensor, camera.film, expected);
  }
}

/// The camera of a file whose film is as high as the expected one is wide, and the reverse, with the film
/// that a job asks for.
TEST(SensorAgainstMitsuba, RaysOfAFilmOfAnotherAspectThanTheFiles) {
  for (const MitsubaSensorRay& expected : mitsuba_sensor_rays) {
    SCOPED_TRACE(expected.sensor);
    const Film wanted = read_camera(expected.sensor).film;
    std::string turned = expected.sensor;
    const auto replace = [&turned](const std::string& name, int32_t value, int32_t other) {
      const std::string before = "name=\"" + name + "\" value=\"";
      const size_t at = turned.find(before + std::to_string(value) + "\"");
      ASSERT_NE(at, std::string::npos);
      turned.replace(at + before.size(), std::to_string(value).size(), std::to_string(other));
    };
    replace("width", wanted.width, 1000);
    replace("height", wanted.height, 1000 * wanted.width / wanted.height);
    const Camera camera = read_camera(turned);
    ASSERT_NE(camera.film.width, wanted.width);
    expect_ray(camera.sensor, wanted, expected);
  }
}

}  // namespace
}  // namespace fogbank::scene::test
