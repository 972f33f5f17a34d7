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

nlohmann::ordered_json sensor_json(const scene::Sensor& sensor, const scene::Film& film) {
  nlohmann::ordered_json json;
  json["kind"] = name_of(sensor.kind);
  for (int row = 0; row < 4; ++row) {
    for (int column = 0; column < 4; ++column) json["to_world"].push_back(sensor.to_world[column][row]);
  }
  if (sensor.kind != scene::SensorKind::orthographic) json["fov_x_degrees"] = sensor.fov_x_degrees(film);
  if (sensor.kind == scene::SensorKind::thinlens) {
    json["aperture_radius"] = sensor.aperture_radius;
    json["focus_distance"] = sensor.focus_distance;
  }
  json["near_clip"] = sensor.near_clip;
  json["far_clip"] = sensor.far_clip;
  json["principal_point_offset"] = {sensor.principal_point_offset.x, sensor.principal_point_offset.y};
  return json;
}

nlohmann::ordered_json error_json(const ErrorEstimate& estimate) {
  nlohmann::ordered_json json;
  if (estimate.noise) json["noise"] = *estimate.noise;
  json["bias"] = estimate.bias;
  if (estimate.error) json["estimated_error"] = *estimate.error;
  if (estimate.true_error) {
    json["true_error"] = {{"relative_error", estimate.true_error->relative_error},
                          {"median", estimate.true_error->median},
                          {"percentile_99", estimate.true_error->percentile_99},
                          {"relative_mse", estimate.true_error->relative_mse}};
  }
  return json;
}

nlohmann::ordered_json cache_json(const Progress& progress) {
  nlohmann::ordered_json json;
  json["epoch"] = progress.epoch;
  json["records_reused"] = progress.records_reused;
  json["records_new"] = progress.records_new;
  json["stages"] = progress.stage;
  json["stage_error"] = progress.stage_error;
  json["decisions"] = nlohmann::ordered_json::array();
  for (const integrators::Decision& decision : progress.decisions)
    json["decisions"].push_back({{"what", decision.what}, {"on", decision.on}, {"reason", decision.reason}});
  return json;
}

nlohmann::ordered_json history_json(const std::vector<HistoryEntry>& history) {
  nlohmann::ordered_json json = nlohmann::ordered_json::array();
  for (const HistoryEntry& entry : history) {
    nlohmann::ordered_json line;
    line["cpu_seconds"] = entry.cpu_seconds;
    line["wall_seconds"] = entry.wall_seconds;
    line["samples"] = entry.samples;
    line["records"] = entry.records;
    line["epoch"] = entry.epoch;
    line.update(error_json(entry.estimate));
    json.push_back(std::move(line));
  }
  return json;
}

}  // namespace

Provenance describe(const RenderSettings& settings, const Progress& progress,
                    const std::vector<HistoryEntry>& history, const std::string& scene_fingerprint) {
  nlohmann::ordered_json json;
  json["max_depth"] = settings.integrator_settings.max_depth;
  json["rr_depth"] = settings.integrator_settings.rr_depth;
  json["hide_emitters"] = settings.integrator_settings.hide_emitters;
  json["samples_per_pixel"] = settings.samples_per_pixel;
  json["time_budget_seconds"] = settings.time_budget_seconds;
  json["error"] = settings.error;
  json["record_budget"] = settings.record_budget;
  json["most_records"] = settings.integrator_settings.most_records;
  json["single_scattering"] = name_of(settings.integrator_settings.single_scattering);
  json["spheres"] = settings.integrator_settings.spheres;
  json["minimum_radius"] = settings.integrator_settings.minimum_radius;
  json["film"] = film_json(settings.film);
  json["sensor"] = sensor_json(settings.sensor, settings.film);
  return {{"fogbank:version", FOGBANK_VERSION},
          {"fogbank:scene", scene_fingerprint},
          {"fogbank:integrator", settings.integrator},
          {"fogbank:settings", json.dump()},
          {"fogbank:seed", std::to_string(settings.seed)},
          {"fogbank:samples_per_pixel", std::to_string(progress.samples_per_pixel)},
          {"fogbank:samples", std::to_string(progress.samples_done)},
          {"fogbank:rays", std::to_string(progress.rays)},
          {"fogbank:render_seconds", std::to_string(progress.render_seconds)},
          {"fogbank:render_cpu_seconds", std::to_string(progress.cpu_seconds)},
          {"fogbank:cache", cache_json(progress).dump()},
          {"fogbank:error", error_json(progress.estimate).dump()},
          {"fogbank:history", history_json(history).dump()}};
}

}  // namespace fogbank::render
