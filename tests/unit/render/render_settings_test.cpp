#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <limits>

#include "core/error.h"
#include "function_integrator.h"

namespace fogbank::render {
namespace {

struct BadSetting {
  const char* field;
  std::function<void(RenderSettings&)> spoil;
};

constexpr double nan = std::numeric_limits<double>::quiet_NaN();

const BadSetting bad_settings[] = {
    {"samples_per_pixel", [](RenderSettings& s) { s.samples_per_pixel = 0; }},
    {"samples_per_pixel", [](RenderSettings& s) { s.samples_per_pixel = (1 << 20) + 1; }},
    {"time_budget_seconds", [](RenderSettings& s) { s.time_budget_seconds = -1; }},
    {"time_budget_seconds", [](RenderSettings& s) { s.time_budget_seconds = nan; }},
    {"time_budget_seconds", [](RenderSettings& s) { s.time_budget_seconds = 1e30; }},
    {"integrator_settings.max_depth", [](RenderSettings& s) { s.integrator_settings.max_depth = -2; }},
    {"integrator_settings.rr_depth", [](RenderSettings& s) { s.integrator_settings.rr_depth = 0; }},
    {"tile_size", [](RenderSettings& s) { s.tile_size = 0; }},
    {"tile_size", [](RenderSettings& s) { s.tile_size = 7; }},
    {"tile_size", [](RenderSettings& s) { s.tile_size = 100000; }},
    {"film.width", [](RenderSettings& s) { s.film.width = 0; }},
    {"film.height", [](RenderSettings& s) { s.film.height = 16385; }},
    {"film.crop",
     [](RenderSettings& s) {
       s.film.crop = {0, 0, 0, 10};
     }},
    {"film.crop",
     [](RenderSettings& s) {
       s.film.crop = {-1, 0, 10, 10};
     }},
    {"film.crop",
     [](RenderSettings& s) {
       s.film.crop = {0, 60, 10, 10};
     }},
    {"film.crop",
     [](RenderSettings& s) {
       s.film.crop = {2147483647, 0, 2147483647, 1};
     }},
    {"film.crop", [](RenderSettings& s) { s = small_settings(16384, 16384, 1); }},
    {"film.filter_radius", [](RenderSettings& s) { s.film.filter_radius = -1; }},
    {"film.filter_stddev", [](RenderSettings& s) { s.film.filter_stddev = 0; }},
    {"sensor.to_world", [](RenderSettings& s) { s.sensor.to_world[2] = s.sensor.to_world[1]; }},
    {"sensor.to_world", [](RenderSettings& s) { s.sensor.to_world[0] = glm::dvec4(0); }},
    {"sensor.to_world", [](RenderSettings& s) { s.sensor.to_world[3][1] = nan; }},
    {"integrator_settings.minimum_radius",
     [](RenderSettings& s) { s.integrator_settings.minimum_radius = -0.5; }},
    {"integrator_settings.minimum_radius",
     [](RenderSettings& s) { s.integrator_settings.minimum_radius = nan; }},
    {"sensor.fov_degrees", [](RenderSettings& s) { s.sensor.fov_degrees = 180; }},
    {"sensor.fov_degrees", [](RenderSettings& s) { s.sensor.fov_degrees = nan; }},
    {"sensor.near_clip", [](RenderSettings& s) { s.sensor.near_clip = 0; }},
    {"sensor.far_clip", [](RenderSettings& s) { s.sensor.far_clip = 1e-3; }},
    {"sensor.aperture_radius", [](RenderSettings& s) { s.sensor.kind = scene::SensorKind::thinlens; }},
    {"sensor.principal_point_offset", [](RenderSettings& s) { s.sensor.principal_point_offset.x = nan; }},
    {"first_region",
     [](RenderSettings& s) {
       s.first_region = scene::Window{0, 0, 0, 0};
     }},
    {"first_region",
     [](RenderSettings& s) {
       s.first_region = scene::Window{60, 60, 10, 10};
     }},
    {"first_region",
     [](RenderSettings& s) {
       s.film.crop = {0, 0, 8, 8};
       s.first_region = scene::Window{8, 0, 8, 8};
     }},
};

TEST(RenderSettings, BadOnesAreRefusedByName) {
  for (const BadSetting& bad : bad_settings) {
    RenderSettings settings = small_settings(64, 64, 16);
    EXPECT_NO_THROW(validate(settings));
    bad.spoil(settings);
    try {
      validate(settings);
      ADD_FAILURE() << bad.field;
    } catch (const Error& error) {
      EXPECT_EQ(error.kind(), ErrorKind::invalid_argument);
      EXPECT_EQ(error.reason(), "INVALID_RENDER_SETTINGS");
      EXPECT_THAT(error.what(), testing::StartsWith(std::string(bad.field) + ": "));
    }
    EXPECT_THROW(RenderJob(function_integrator(ray_and_random_function), settings), Error);
  }
}

TEST(RenderSettings, LimitsThemselvesAreAllowed) {
  RenderSettings settings = small_settings(16384, 4096, RenderLimits::samples_per_pixel);
  settings.tile_size = 128;
  EXPECT_NO_THROW(validate(settings));
  // A small crop of the largest film is small.
  settings = small_settings(16384, 16384, 1);
  settings.film.crop = {16376, 16376, 8, 8};
  EXPECT_NO_THROW(validate(settings));
}

}  // namespace
}  // namespace fogbank::render
