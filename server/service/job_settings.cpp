#include "service/job_settings.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <string>

#include "core/error.h"
#include "service/field_errors.h"
#include "service/limits.h"
#include "service/rpc_error.h"

namespace fogbank::service {

namespace {

[[noreturn]] void refuse(const std::string& field, const std::string& message) {
  refuse_field("settings." + field, message);
}

void check_range(const char* field, int64_t value, int64_t lowest, int64_t highest) {
  if (value < lowest || value > highest) {
    refuse(field,
           std::to_string(value) + " is not in " + std::to_string(lowest) + " .. " + std::to_string(highest));
  }
}

scene::Window to_engine(const v1::Window& window) {
  return {window.x(), window.y(), window.width(), window.height()};
}

void set_window(v1::Window& message, const scene::Window& window) {
  message.set_x(window.x);
  message.set_y(window.y);
  message.set_width(window.width);
  message.set_height(window.height);
}

/// Side `b` of a film whose side `a` is given, at the scene's aspect ratio.
int32_t matching_side(int32_t a, int32_t scene_a, int32_t scene_b) {
  const double side = std::round(static_cast<double>(a) * scene_b / scene_a);
  return static_cast<int32_t>(std::clamp(side, 1.0, static_cast<double>(limits::max_image_side)));
}

void resolve_film(const v1::RenderSettings& requested, const scene::Film& scene_film, scene::Film& film) {
  film = scene_film;
  if (requested.has_width()) check_range("width", requested.width(), 1, limits::max_image_side);
  if (requested.has_height()) check_range("height", requested.height(), 1, limits::max_image_side);
  if (requested.has_width()) {
    film.width = requested.width();
    film.height = requested.has_height() ? requested.height()
                                         : matching_side(film.width, scene_film.width, scene_film.height);
  } else if (requested.has_height()) {
    film.height = requested.height();
    film.width = matching_side(film.height, scene_film.height, scene_film.width);
  }
  if (requested.has_crop()) {
    film.crop = to_engine(requested.crop());
  } else if (film.width != scene_film.width || film.height != scene_film.height) {
    film.crop = {0, 0, film.width, film.height};
  }
}

void resolve_camera(const v1::CameraOverride& camera, scene::Sensor& sensor) {
  if (camera.to_world_size() != 0) {
    if (camera.to_world_size() != 16) refuse("camera.to_world", "needs 16 numbers, row by row");
    for (int row = 0; row < 4; ++row) {
      for (int column = 0; column < 4; ++column)
        sensor.to_world[column][row] = camera.to_world(4 * row + column);
    }
    if (sensor.to_world[0][3] != 0 || sensor.to_world[1][3] != 0 || sensor.to_world[2][3] != 0 ||
        sensor.to_world[3][3] != 1) {
      refuse("camera.to_world", "its last row must be 0 0 0 1");
    }
  }
  if (camera.has_fov_degrees()) {
    if (sensor.kind == scene::SensorKind::orthographic)
      refuse("camera.fov_degrees", "the camera is orthographic");
    sensor.fov_degrees = camera.fov_degrees();
    sensor.fov_axis = scene::FovAxis::x;
  }
  if ((camera.has_aperture_radius() || camera.has_focus_distance()) &&
      sensor.kind != scene::SensorKind::thinlens) {
    refuse(camera.has_aperture_radius() ? "camera.aperture_radius" : "camera.focus_distance",
           "the scene's camera is no thinlens");
  }
  if (camera.has_aperture_radius()) sensor.aperture_radius = camera.aperture_radius();
  if (camera.has_focus_distance()) sensor.focus_distance = camera.focus_distance();
}

void resolve_cache(const v1::RenderSettings& requested, render::RenderSettings& engine) {
  integrators::IntegratorSettings& settings = engine.integrator_settings;
  if (!v1::SingleScattering_IsValid(requested.single_scattering()))
    refuse("single_scattering", "is not a SingleScattering");
  switch (requested.single_scattering()) {
    case v1::SINGLE_SCATTERING_DIRECT:
      settings.single_scattering = integrators::SingleScattering::direct;
      break;
    case v1::SINGLE_SCATTERING_CACHED:
      settings.single_scattering = integrators::SingleScattering::cached;
      break;
    default:
      settings.single_scattering = integrators::SingleScattering::automatic;
  }
  settings.spheres = requested.spheres();
  settings.minimum_radius = requested.minimum_radius();
  if (requested.has_error() && !(requested.error() > 0)) refuse("error", "must be positive");
  engine.error = requested.error();
  if (requested.has_epoch()) {
    if (requested.has_records()) refuse("records", "a job of a given epoch makes no records");
    settings.most_records = 0;
  }
  if (requested.has_records()) {
    check_range("records", requested.records(), 0, render::RenderLimits::most_records);
    engine.record_budget = requested.records();
    settings.most_records = requested.records();
  }
  for (const int aov : requested.aovs()) {
    switch (aov) {
      case v1::AOV_RADIUS:
        engine.aovs.push_back(render::Aov::radius);
        break;
      case v1::AOV_RECORD_DENSITY:
        engine.aovs.push_back(render::Aov::record_density);
        break;
      case v1::AOV_REJECTED:
        engine.aovs.push_back(render::Aov::rejected);
        break;
      case v1::AOV_VARIANCE:
        engine.aovs.push_back(render::Aov::variance);
        break;
      case v1::AOV_BIAS:
        engine.aovs.push_back(render::Aov::bias);
        break;
      default:
        refuse("aovs", std::to_string(aov) + " is not an Aov");
    }
  }
}

bool splits_light(const std::string& integrator) {
  const auto all = integrators::supported_integrators();
  return std::ranges::any_of(
      all, [&](const auto& info) { return info.name == integrator && info.single_scattering; });
}

/// What only integrators with a cache understand is refused for others, instead of doing nothing.
void check_cached(const v1::RenderSettings& requested, const std::string& integrator) {
  if (requested.single_scattering() != v1::SINGLE_SCATTERING_UNSPECIFIED && !splits_light(integrator))
    refuse("single_scattering", "the integrator \"" + integrator + "\" has one way for all light");
  if (uses_cache(integrator)) return;
  const char* field = requested.has_records()          ? "records"
                      : requested.spheres()            ? "spheres"
                      : requested.has_minimum_radius() ? "minimum_radius"
                      : requested.aovs_size() > 0      ? "aovs"
                      : requested.has_epoch()          ? "epoch"
                                                       : nullptr;
  if (field != nullptr) refuse(field, "the integrator \"" + integrator + "\" has no cache");
}

/// The engine names its own fields in front of a colon; clients know the request's.
[[noreturn]] void refuse_for_engine(const Error& error) {
  static const std::map<std::string, std::string> wire_names = {
      {"film.width", "width"},
      {"film.height", "height"},
      {"film.crop", "crop"},
      {"integrator_settings.max_depth", "max_depth"},
      {"integrator_settings.rr_depth", "rr_depth"},
      {"sensor.to_world", "camera.to_world"},
      {"sensor.fov_degrees", "camera.fov_degrees"},
      {"sensor.aperture_radius", "camera.aperture_radius"},
      {"sensor.focus_distance", "camera.focus_distance"},
      {"integrator_settings.minimum_radius", "minimum_radius"},
      {"first_region", "region"},
      {"record_budget", "records"},
      {"integrator_settings.most_records", "records"},
      {"reference", "reference_sha256"},
  };
  const EngineFieldError parts(error);
  const auto wire = wire_names.find(parts.field);
  refuse(wire == wire_names.end() ? parts.field : wire->second, parts.message);
}

void check_integrator(const std::string& name) {
  std::string known;
  for (const auto& integrator : integrators::supported_integrators()) {
    if (integrator.name == name) return;
    known += (known.empty() ? "" : ", ") + integrator.name;
  }
  refuse("integrator", "\"" + name + "\" is not one of: " + known);
}

void expect_cache(const std::string& integrator) {
  if (!uses_cache(integrator)) refuse("integrator", "\"" + integrator + "\" has no cache to fill");
}

}  // namespace

render::PixelType pixel_type(const v1::RenderSettings& effective) {
  return effective.pixel_type() == v1::PIXEL_TYPE_FLOAT ? render::PixelType::single_float
                                                        : render::PixelType::half_float;
}

bool uses_cache(const std::string& integrator) {
  const auto all = integrators::supported_integrators();
  return std::ranges::any_of(all, [&](const auto& info) { return info.name == integrator && info.cached; });
}

JobSettings resolve_settings(const v1::RenderSettings& requested, const scene::Scene& scene,
                             int server_threads) {
  JobSettings resolved;
  render::RenderSettings& engine = resolved.engine;
  v1::RenderSettings& effective = resolved.effective;
  effective = requested;

  engine.integrator = requested.integrator().empty() ? scene.defaults.integrator : requested.integrator();
  check_integrator(engine.integrator);
  engine.integrator_settings.max_depth =
      requested.has_max_depth() ? requested.max_depth() : scene.defaults.max_depth;
  engine.integrator_settings.rr_depth =
      requested.has_rr_depth() ? requested.rr_depth() : scene.defaults.rr_depth;
  engine.integrator_settings.hide_emitters = scene.defaults.hide_emitters;
  check_cached(requested, engine.integrator);
  resolve_cache(requested, engine);
  // With a time or an error to end at, the scene's number of samples would only be in the way.
  const bool open_end = requested.has_time_budget_seconds() || requested.has_error();
  engine.samples_per_pixel = requested.has_samples_per_pixel() ? requested.samples_per_pixel()
                             : open_end                        ? render::RenderLimits::samples_per_pixel
                                                               : scene.defaults.samples_per_pixel;
  if (requested.has_time_budget_seconds() && !(requested.time_budget_seconds() > 0)) {
    refuse("time_budget_seconds", "must be positive");
  }
  engine.time_budget_seconds = requested.time_budget_seconds();
  engine.seed = requested.seed();
  resolve_film(requested, scene.film, engine.film);
  engine.sensor = scene.sensor;
  resolve_camera(requested.camera(), engine.sensor);
  engine.tile_size =
      requested.has_tile_size() ? requested.tile_size() : static_cast<int32_t>(limits::default_tile_size);
  if (!v1::TileOrder_IsValid(requested.tile_order())) refuse("tile_order", "is not a TileOrder");
  engine.tile_order =
      requested.tile_order() == v1::TILE_ORDER_SCAN ? render::TileOrder::scan : render::TileOrder::spiral;
  if (requested.has_region()) engine.first_region = to_engine(requested.region());
  if (!v1::PixelType_IsValid(requested.pixel_type())) refuse("pixel_type", "is not a PixelType");
  if (requested.has_max_threads()) check_range("max_threads", requested.max_threads(), 1, 1 << 20);
  const double interval = requested.has_update_interval_seconds() ? requested.update_interval_seconds()
                                                                  : limits::default_update_interval_seconds;
  if (!(interval >= limits::min_update_interval_seconds && interval <= limits::max_update_interval_seconds)) {
    refuse("update_interval_seconds", std::to_string(interval) + " is not in " +
                                          std::to_string(limits::min_update_interval_seconds) + " .. " +
                                          std::to_string(limits::max_update_interval_seconds));
  }
  try {
    render::validate(engine);
  } catch (const Error& error) {
    refuse_for_engine(error);
  }

  effective.set_integrator(engine.integrator);
  if (splits_light(engine.integrator) && requested.single_scattering() == v1::SINGLE_SCATTERING_UNSPECIFIED)
    effective.set_single_scattering(v1::SINGLE_SCATTERING_AUTOMATIC);
  effective.set_samples_per_pixel(engine.samples_per_pixel);
  effective.set_width(engine.film.width);
  effective.set_height(engine.film.height);
  set_window(*effective.mutable_crop(), engine.film.crop);
  effective.set_max_depth(engine.integrator_settings.max_depth);
  effective.set_rr_depth(engine.integrator_settings.rr_depth);
  effective.set_tile_size(engine.tile_size);
  if (requested.tile_order() == v1::TILE_ORDER_UNSPECIFIED) effective.set_tile_order(v1::TILE_ORDER_SPIRAL);
  if (requested.pixel_type() == v1::PIXEL_TYPE_UNSPECIFIED) effective.set_pixel_type(v1::PIXEL_TYPE_HALF);
  effective.set_max_threads(
      std::min(requested.has_max_threads() ? requested.max_threads() : server_threads, server_threads));
  effective.set_update_interval_seconds(interval);
  return resolved;
}

FillSettings resolve_fill(const v1::FillCacheRequest& request, const scene::Scene& scene,
                          int server_threads) {
  if (request.settings().has_camera()) refuse("camera", "a fill has a list of cameras of its own");
  if (request.settings().has_epoch()) refuse("epoch", "a fill adds to the newest epoch");
  if (request.cameras_size() > limits::max_fill_cameras) {
    throw RpcError(grpc::StatusCode::INVALID_ARGUMENT, "TOO_MANY_CAMERAS",
                   std::to_string(request.cameras_size()) + " cameras are above the limit of " +
                       std::to_string(limits::max_fill_cameras),
                   {{"limit", "max_fill_cameras"}});
  }
  FillSettings resolved{.engine = resolve_settings(request.settings(), scene, server_threads).engine,
                        .cameras = {}};
  expect_cache(resolved.engine.integrator);
  if (request.cameras().empty()) resolved.cameras.push_back(resolved.engine.sensor);
  for (int i = 0; i < request.cameras_size(); ++i) {
    v1::RenderSettings settings = request.settings();
    *settings.mutable_camera() = request.cameras(i);
    try {
      resolved.cameras.push_back(resolve_settings(settings, scene, server_threads).engine.sensor);
    } catch (const RpcError& error) {
      const std::string field = "cameras[" + std::to_string(i) + "]";
      throw RpcError(error.code(), error.reason(), field + ": " + error.what(), {{"field", field}});
    }
  }
  return resolved;
}

void check_fill_only(const v1::CreateJobRequest& request, const v1::RenderSettings& effective) {
  if (!request.leased()) {
    throw RpcError(grpc::StatusCode::INVALID_ARGUMENT, "INVALID_SETTINGS",
                   "fill_only: is for leased jobs; FillCache fills the cache here", {{"field", "fill_only"}});
  }
  expect_cache(effective.integrator());
  if (effective.has_epoch()) refuse("epoch", "a fill adds to the newest epoch");
  if (effective.time_budget_seconds() > 0) refuse("time_budget_seconds", "a leased fill has none");
}

}  // namespace fogbank::service
