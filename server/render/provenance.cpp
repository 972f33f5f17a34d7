// The header that says how an image was made.
#include <nlohmann/json.hpp>
#include <string>

#include "render/exr.h"

namespace fogbank::render {

namespace {

const char* name_of(scene::ReconstructionFilter filter) {
  switch (filter) {
    case scene::ReconstructionFilter::box:
      return "box";
    case scene::ReconstructionFilter::tent:
      return "tent";
    case scene::ReconstructionFilter::gaussian:
      return "gaussian";
  }
  return "";
}

const char* name_of(scene::SensorKind kind) {
  switch (kind) {
    case scene::SensorKind::perspective:
      return "perspective";
    case scene::SensorKind::thinlens:
      return "thinlens";
    case scene::SensorKind::orthographic:
      return "orthographic";
  }
  return "";
}

nlohmann::ordered_json film_json(const scene::Film& film) {
  nlohmann::ordered_json json;
  json["width"] = film.width;
  json["height"] = film.height;
  json["crop"] = {film.crop.x, film.crop.y, film.crop.width, film.crop.height};
  json["filter"] = name_of(film.filter);
  json["filter_radius"] = film.filter_radius;
  if (film.filter == scene::ReconstructionFilter::gaussian) json["filter_stddev"] = film.filter_stddev;
  return json;
}

nlohmann::ordered_json sensor_json(const scene::Sensor& sensor) {
  nlohmann::ordered_json json;
  json["kind"] = name_of(sensor.kind);
  for (int row = 0; row < 4; ++row) {
    for (int column = 0; column < 4; ++column) json["to_world"].push_back(sensor.to_world[column][row]);
  }
  if (sensor.kind != scene::SensorKind::orthographic) json["fov_x_degrees"] = sensor.fov_x_degrees;
  if (sensor.kind == scene::SensorKind::thinlens) {
    json["aperture_radius"] = sensor.aperture_radius;
    json["focus_distance"] = sensor.focus_distance;
  }
  json["near_clip"] = sensor.near_clip;
  json["far_clip"] = sensor.far_clip;
  json["principal_point_offset"] = {sensor.principal_point_offset.x, sensor.principal_point_offset.y};
  return json;
}

}  // namespace

Provenance describe(const RenderSettings& settings, const Progress& progress,
                    const std::string& scene_fingerprint) {
  nlohmann::ordered_json json;
  json["max_depth"] = settings.integrator_settings.max_depth;
  json["rr_depth"] = settings.integrator_settings.rr_depth;
  json["hide_emitters"] = settings.integrator_settings.hide_emitters;
  json["samples_per_pixel"] = settings.samples_per_pixel;
  json["time_budget_seconds"] = settings.time_budget_seconds;
  json["film"] = film_json(settings.film);
  json["sensor"] = sensor_json(settings.sensor);
  return {{"fogbank:version", FOGBANK_VERSION},
          {"fogbank:scene", scene_fingerprint},
          {"fogbank:integrator", settings.integrator},
          {"fogbank:settings", json.dump()},
          {"fogbank:seed", std::to_string(settings.seed)},
          {"fogbank:samples_per_pixel", std::to_string(progress.samples_per_pixel)},
          {"fogbank:samples", std::to_string(progress.samples_done)},
          {"fogbank:rays", std::to_string(progress.rays)},
          {"fogbank:render_seconds", std::to_string(progress.render_seconds)},
          {"fogbank:render_cpu_seconds", std::to_string(progress.cpu_seconds)}};
}

}  // namespace fogbank::render
