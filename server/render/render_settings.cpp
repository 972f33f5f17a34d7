#include "render/render_settings.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <string>

#include "core/error.h"
#include "render/tiles.h"

namespace fogbank::render {

namespace {

[[noreturn]] void fail(const std::string& field, const std::string& message) {
  throw Error(ErrorKind::invalid_argument, "INVALID_RENDER_SETTINGS", field + ": " + message);
}

template <typename Number>
void check_range(const char* field, Number value, Number lowest, Number highest) {
  // Written so that NaN fails.
  if (value >= lowest && value <= highest) return;
  fail(field,
       std::to_string(value) + " is not in " + std::to_string(lowest) + " .. " + std::to_string(highest));
}

void check_positive(const char* field, double value) {
  if (!(std::isfinite(value) && value > 0))
    fail(field, std::to_string(value) + " is not positive and finite");
}

std::string to_string(const scene::Window& window) {
  return std::to_string(window.width) + "x" + std::to_string(window.height) + " at (" +
         std::to_string(window.x) + ", " + std::to_string(window.y) + ")";
}

void validate_film(const scene::Film& film) {
  check_range("film.width", film.width, 1, RenderLimits::film_side);
  check_range("film.height", film.height, 1, RenderLimits::film_side);
  const scene::Window& crop = film.crop;
  // 64 bits, as x + width of a hostile window need not fit into 32.
  if (crop.width < 1 || crop.height < 1 || crop.x < 0 || crop.y < 0 ||
      int64_t{crop.x} + crop.width > film.width || int64_t{crop.y} + crop.height > film.height) {
    fail("film.crop", to_string(crop) + " is empty or not inside the film of " + std::to_string(film.width) +
                          "x" + std::to_string(film.height));
  }
  if (int64_t{crop.width} * crop.height > RenderLimits::crop_pixels) {
    fail("film.crop",
         to_string(crop) + " has more than " + std::to_string(RenderLimits::crop_pixels) + " pixels");
  }
  check_positive("film.filter_radius", film.filter_radius);
  if (film.filter == scene::ReconstructionFilter::gaussian) {
    check_positive("film.filter_stddev", film.filter_stddev);
  }
}

void validate_sensor(const scene::Sensor& sensor, const scene::Film& film) {
  for (int column = 0; column < 4; ++column) {
    for (int row = 0; row < 4; ++row) {
      if (!std::isfinite(sensor.to_world[column][row]))
        fail("sensor.to_world", "has an element that is not finite");
    }
  }
  const Vec3d x(sensor.to_world[0]);
  const Vec3d y(sensor.to_world[1]);
  const Vec3d z(sensor.to_world[2]);
  // Relative to the lengths of the axes, so that a scene in kilometres and one in micrometres are judged
  // alike.
  const double volume = std::fabs(glm::dot(x, glm::cross(y, z)));
  if (!(volume > 1e-9 * glm::length(x) * glm::length(y) * glm::length(z)))
    fail("sensor.to_world", "is singular");
  if (sensor.kind != scene::SensorKind::orthographic) {
    if (!(sensor.fov_degrees > 0 && sensor.fov_degrees < 180))
      fail("sensor.fov_degrees", std::to_string(sensor.fov_degrees) + " is not between 0 and 180");
    // Of films that are much wider than high, or the reverse; as for files.
    const double horizontal = sensor.fov_x_degrees(film);
    if (!(horizontal > 1e-6 && horizontal < 179.999))
      fail("film.width", "makes the horizontal field of view " + std::to_string(horizontal) + " degrees");
  }
  check_positive("sensor.near_clip", sensor.near_clip);
  check_positive("sensor.far_clip", sensor.far_clip);
  if (sensor.far_clip <= sensor.near_clip) fail("sensor.far_clip", "is not beyond sensor.near_clip");
  if (sensor.kind == scene::SensorKind::thinlens) {
    check_positive("sensor.aperture_radius", sensor.aperture_radius);
    check_positive("sensor.focus_distance", sensor.focus_distance);
  }
  if (!std::isfinite(sensor.principal_point_offset.x) || !std::isfinite(sensor.principal_point_offset.y)) {
    fail("sensor.principal_point_offset", "is not finite");
  }
}

void validate_targets(const RenderSettings& settings) {
  check_range("samples_per_pixel", settings.samples_per_pixel, 1, RenderLimits::samples_per_pixel);
  check_range("time_budget_seconds", settings.time_budget_seconds, 0.0, RenderLimits::time_budget_seconds);
  if (settings.fill_only && settings.time_budget_seconds > 0)
    fail("time_budget_seconds", "a job that only fills the cache has none");
  if (settings.error != 0)
    check_range("error", settings.error, RenderLimits::smallest_error, RenderLimits::largest_error);
  check_range("record_budget", settings.record_budget, int64_t{0}, RenderLimits::most_records);
  check_range("integrator_settings.most_records", settings.integrator_settings.most_records, int64_t{0},
              RenderLimits::most_records);
}

void validate_reference(const ReferenceImage& reference, const scene::Window& crop) {
  if (reference.window != crop)
    fail("reference", to_string(reference.window) + " is not the crop window, " + to_string(crop));
  if (reference.rgb.size() != static_cast<size_t>(crop.width) * static_cast<size_t>(crop.height) * 3)
    fail("reference", "doesn't have three numbers a pixel");
  if (!std::ranges::all_of(reference.rgb, [](float value) { return std::isfinite(value) && value >= 0; }))
    fail("reference", "has a pixel that is negative or not finite");
}

constexpr std::array<std::pair<Aov, const char*>, 5> aov_names{{{Aov::radius, "radius"},
                                                                {Aov::record_density, "record-density"},
                                                                {Aov::rejected, "rejected"},
                                                                {Aov::variance, "variance"},
                                                                {Aov::bias, "bias"}}};

constexpr std::array<std::pair<integrators::SingleScattering, const char*>, 3> single_scattering_names{
    {{integrators::SingleScattering::automatic, "auto"},
     {integrators::SingleScattering::direct, "direct"},
     {integrators::SingleScattering::cached, "cached"}}};

}  // namespace

std::string name_of(Aov aov) {
  const auto entry = std::ranges::find(aov_names, aov, &std::pair<Aov, const char*>::first);
  return entry->second;
}

Aov parse_aov(const std::string& name) {
  std::string known;
  for (const auto& [aov, known_name] : aov_names) {
    if (name == known_name) return aov;
    known += (known.empty() ? "" : ", ") + std::string(known_name);
  }
  throw Error(ErrorKind::invalid_argument, "UNKNOWN_AOV",
              "there is no AOV \"" + name + "\"; known: " + known);
}

std::string name_of(integrators::SingleScattering technique) {
  for (const auto& [known, name] : single_scattering_names)
    if (known == technique) return name;
  return {};
}

integrators::SingleScattering parse_single_scattering(const std::string& name) {
  std::string known;
  for (const auto& [technique, known_name] : single_scattering_names) {
    if (name == known_name) return technique;
    known += (known.empty() ? "" : ", ") + std::string(known_name);
  }
  fail("single_scattering", "there is no \"" + name + "\"; known: " + known);
}

void validate(const RenderSettings& settings) {
  validate_targets(settings);
  check_range("integrator_settings.max_depth", settings.integrator_settings.max_depth, -1,
              RenderLimits::path_depth);
  check_range("integrator_settings.rr_depth", settings.integrator_settings.rr_depth, 1,
              RenderLimits::path_depth);
  const double minimum_radius = settings.integrator_settings.minimum_radius;
  if (!(std::isfinite(minimum_radius) && minimum_radius >= 0))
    fail("integrator_settings.minimum_radius", std::to_string(minimum_radius) + " is negative or not finite");
  check_range("tile_size", settings.tile_size, RenderLimits::smallest_tile, RenderLimits::largest_tile);
  validate_film(settings.film);
  validate_sensor(settings.sensor, settings.film);
  for (size_t i = 0; i < settings.aovs.size(); ++i) {
    if (std::count(settings.aovs.begin(), settings.aovs.end(), settings.aovs[i]) > 1)
      fail("aovs", "\"" + name_of(settings.aovs[i]) + "\" is there more than once");
  }
  if (settings.reference) validate_reference(*settings.reference, settings.film.crop);
  if (settings.first_region) {
    const scene::Window& region = *settings.first_region;
    const scene::Window film{0, 0, settings.film.width, settings.film.height};
    if (region.width < 1 || region.height < 1 || region.x < 0 || region.y < 0 ||
        int64_t{region.x} + region.width > film.width || int64_t{region.y} + region.height > film.height ||
        !overlap(region, settings.film.crop)) {
      fail("first_region", to_string(region) + " is empty, not inside the film or outside the crop window");
    }
  }
}

}  // namespace fogbank::render
