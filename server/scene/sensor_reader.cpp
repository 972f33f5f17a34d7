#include "scene/sensor_reader.h"

#include <algorithm>
#include <cmath>
#include <cstdlib>

#include "scene/text.h"
#include "scene/xml/values.h"

namespace fogbank::scene {
namespace {

constexpr double degrees_per_radian = 180 / 3.14159265358979323846;
constexpr double largest_distance = 1e15;
constexpr int64_t largest_side = 16384;  ///< as render settings allow

std::string location(const ObjectDescription& object, std::string_view property) {
  SourceLocation where = object.where;
  if (const Property* found = object.find(property)) where.line = found->where.line;
  return where.to_string() + ": ";
}

/// Reads away parameters that have no meaning here; one that is set to something else than `expected` is
/// worth a warning.
void ignore(PropertyReader& reader, const char* name, const std::vector<std::string>& expected,
            std::vector<std::string>& warnings) {
  const PropertyValue* value = reader.raw(name);
  if (!value) return;
  const auto* text = std::get_if<std::string>(value);
  if (text && std::find(expected.begin(), expected.end(), *text) != expected.end()) return;
  warnings.push_back(location(reader.object(), name) + "parameter " + quote(name) + " is ignored");
}

/// "50mm", or a number of millimetres.
double focal_length_millimetres(PropertyReader& reader) {
  const PropertyValue* raw = reader.raw("focal_length");
  if (!raw) return 50;
  std::string text;
  if (const auto* given = std::get_if<std::string>(raw))
    text = *given;
  else
    text = number_text(reader.number("focal_length", 50, -largest_distance, largest_distance));
  std::string_view digits = trim(text);
  if (digits.ends_with("mm")) digits.remove_suffix(2);
  const std::optional<double> length = parse_number(digits);
  if (!length || !(*length > 0) || !std::isfinite(*length))
    reader.fail_at("focal_length", "INVALID_VALUE", "must be a length such as '50mm', is " + quote(text));
  return *length;
}

FovAxis read_fov_axis(PropertyReader& reader) {
  const std::string axis = reader.choice("fov_axis", "x", {"x", "y", "diagonal", "smaller", "larger"});
  if (axis == "y") return FovAxis::y;
  if (axis == "diagonal") return FovAxis::diagonal;
  if (axis == "smaller") return FovAxis::smaller;
  if (axis == "larger") return FovAxis::larger;
  return FovAxis::x;
}

void read_fov(PropertyReader& reader, const Film& film, Sensor& sensor) {
  sensor.fov_axis = read_fov_axis(reader);
  if (const std::optional<double> given = reader.number_if_given("fov", 0.0, 180.0)) {
    if (reader.has("focal_length"))
      reader.fail("CONFLICTING_PARAMETERS", "give either 'fov' or 'focal_length', not both");
    sensor.fov_degrees = *given;
  } else {
    // Of 35 mm film, 36 mm x 24 mm, along its diagonal.
    sensor.fov_degrees =
        2 * std::atan(0.5 * std::hypot(36.0, 24.0) / focal_length_millimetres(reader)) * degrees_per_radian;
    sensor.fov_axis = FovAxis::diagonal;
  }
  const double horizontal = sensor.fov_x_degrees(film);
  // At the ends of (0, 180) the image has no width or an infinite one; floats need some room.
  if (!(sensor.fov_degrees > 0) || !(sensor.fov_degrees < 180) || !(horizontal > 1e-6) ||
      !(horizontal < 179.999))
    reader.fail("OUT_OF_RANGE", "the horizontal field of view must lie between 0 and 180 degrees, is " +
                                    number_text(horizontal));
}

/// Mitsuba refuses scale factors in a camera's transform; old exporters write them, with no effect on the
/// image.
Mat4d without_scale(const Mat4d& to_world, const SourceLocation& where, std::vector<std::string>& warnings) {
  Mat4d result = to_world;
  bool is_scaled = false;
  for (int column = 0; column < 3; ++column) {
    const double length = glm::length(Vec3d(to_world[column]));
    is_scaled = is_scaled || std::abs(length - 1) > 1e-3;
    result[column] = glm::dvec4(Vec3d(to_world[column]) / length, 0.0);
  }
  if (is_scaled)
    warnings.push_back(where.to_string() + ": scale factors in the camera's 'to_world' are ignored");
  return result;
}

void read_filter(const ObjectDescription& description, Film& film, SceneBuilder& builder) {
  PropertyReader reader(description);
  constexpr double smallest = 1e-3;
  constexpr double largest = 32;
  if (description.type == "box") {
    film.filter = ReconstructionFilter::box;
    film.filter_radius = static_cast<float>(reader.number("radius", 0.5, smallest, largest));
  } else if (description.type == "tent") {
    film.filter = ReconstructionFilter::tent;
    film.filter_radius = static_cast<float>(reader.number("radius", 1.0, smallest, largest));
  } else if (description.type == "gaussian") {
    film.filter = ReconstructionFilter::gaussian;
    film.filter_stddev = static_cast<float>(reader.number("stddev", 0.5, smallest, largest));
    film.filter_radius = 4 * film.filter_stddev;
  } else if (description.type == "mitchell" || description.type == "catmullrom" ||
             description.type == "lanczos") {
    // Filters with negative lobes can't be sampled with equal positive weights.
    builder.scene().warnings.push_back(description.where.to_string() + ": filter " + quote(description.type) +
                                       " is replaced by 'gaussian'");
    return;
  } else {
    builder.unknown_plugin(description, {"box", "gaussian", "tent"}, "is replaced by 'gaussian'");
    return;
  }
  reader.finish(builder.lenient_warnings());
}

void read_film(const ObjectDescription& description, SceneBuilder& builder) {
  Film& film = builder.scene().film;
  std::vector<std::string>& warnings = builder.scene().warnings;
  PropertyReader reader(description);
  if (description.type == "ldrfilm")
    warnings.push_back(description.where.to_string() +
                       ": 'ldrfilm' is read as 'hdrfilm': pixels stay linear");
  else if (description.type != "hdrfilm")
    builder.unknown_plugin(description, {"hdrfilm"}, "is read as 'hdrfilm'");
  film.width = static_cast<int32_t>(reader.integer("width", 768, 1, largest_side));
  film.height = static_cast<int32_t>(reader.integer("height", 576, 1, largest_side));
  film.crop.x = static_cast<int32_t>(reader.integer("crop_offset_x", 0, 0, largest_side));
  film.crop.y = static_cast<int32_t>(reader.integer("crop_offset_y", 0, 0, largest_side));
  film.crop.width = static_cast<int32_t>(reader.integer("crop_width", film.width, 1, largest_side));
  film.crop.height = static_cast<int32_t>(reader.integer("crop_height", film.height, 1, largest_side));
  if (film.crop.x + film.crop.width > film.width || film.crop.y + film.crop.height > film.height)
    reader.fail("CROP_OUTSIDE_FILM", "the crop window, " + std::to_string(film.crop.width) + " x " +
                                         std::to_string(film.crop.height) + " at (" +
                                         std::to_string(film.crop.x) + ", " + std::to_string(film.crop.y) +
                                         "), leaves the film of " + std::to_string(film.width) + " x " +
                                         std::to_string(film.height));
  const std::vector<ObjectPointer> filters = reader.children("rfilter");
  if (!filters.empty()) read_filter(*filters.front(), film, builder);
  ignore(reader, "file_format", {"openexr"}, warnings);
  ignore(reader, "pixel_format", {"rgb", "rgba"}, warnings);
  ignore(reader, "component_format", {"float16", "float32"}, warnings);
  for (const char* name : {"attach_log", "banner", "compensate", "exposure", "gamma", "high_quality_edges",
                           "key", "sample_border", "tonemap_method", "burn", "variable"})
    ignore(reader, name, {}, warnings);
  reader.finish(&warnings);
}

void read_sampler(const ObjectDescription& description, SceneBuilder& builder) {
  Scene& scene = builder.scene();
  PropertyReader reader(description);
  if (description.type != "independent")
    scene.warnings.push_back(description.where.to_string() + ": sampler " + quote(description.type) +
                             " is replaced by counter-based random numbers");
  scene.defaults.samples_per_pixel = static_cast<int32_t>(
      reader.integer("sample_count", scene.defaults.samples_per_pixel, 1, int64_t{1} << 20));
  for (const char* name : {"seed", "jitter", "dimension", "scramble"}) reader.raw(name);
  reader.finish(&scene.warnings);
}

}  // namespace

void read_sensor(const ObjectDescription& description, SceneBuilder& builder) {
  Scene& scene = builder.scene();
  Sensor& sensor = scene.sensor;
  PropertyReader reader(description);
  if (description.type == "perspective")
    sensor.kind = SensorKind::perspective;
  else if (description.type == "thinlens")
    sensor.kind = SensorKind::thinlens;
  else if (description.type == "orthographic")
    sensor.kind = SensorKind::orthographic;
  else
    builder.unknown_plugin(description, {"orthographic", "perspective", "thinlens"},
                           "is replaced by 'perspective'");

  const std::vector<ObjectPointer> films = reader.children("film");
  if (films.size() > 1) reader.fail("DUPLICATE_PARAMETER", "a sensor has one <film>");
  if (!films.empty()) read_film(*films.front(), builder);
  const std::vector<ObjectPointer> samplers = reader.children("sampler");
  if (samplers.size() > 1) reader.fail("DUPLICATE_PARAMETER", "a sensor has one <sampler>");
  if (!samplers.empty()) read_sampler(*samplers.front(), builder);
  const std::vector<ObjectPointer> media = reader.children("medium");
  if (media.size() > 1) reader.fail("DUPLICATE_PARAMETER", "a sensor is in one <medium>");
  if (!media.empty()) sensor.medium = builder.medium(media.front());

  sensor.near_clip = reader.number("near_clip", 1e-2, 1e-15, largest_distance);
  sensor.far_clip = reader.number("far_clip", 1e4, 1e-15, largest_distance);
  if (!(sensor.near_clip < sensor.far_clip))
    reader.fail("OUT_OF_RANGE", "'near_clip' must be below 'far_clip'");
  sensor.to_world = reader.transform("to_world");
  if (sensor.kind != SensorKind::orthographic) {
    read_fov(reader, scene.film, sensor);
    sensor.to_world = without_scale(sensor.to_world, description.where, scene.warnings);
  }
  sensor.principal_point_offset.x = reader.number("principal_point_offset_x", 0.0, -1e3, 1e3);
  sensor.principal_point_offset.y = reader.number("principal_point_offset_y", 0.0, -1e3, 1e3);
  if (sensor.kind == SensorKind::thinlens) {
    if (!reader.has("aperture_radius"))
      reader.fail("MISSING_PARAMETER", "parameter 'aperture_radius' is missing");
    sensor.aperture_radius = reader.number("aperture_radius", 0.0, 0.0, largest_distance);
    sensor.focus_distance = reader.number("focus_distance", sensor.far_clip, 1e-15, largest_distance);
  } else {
    reader.raw("focus_distance");  // a perspective camera of Mitsuba has one too, without effect
  }
  for (const char* name : {"shutter_open", "shutter_close"}) ignore(reader, name, {}, scene.warnings);
  reader.finish(builder.lenient_warnings());
}

void read_integrator(const ObjectDescription& description, RenderDefaults& defaults,
                     std::vector<std::string>& warnings) {
  PropertyReader reader(description);
  const std::vector<ObjectPointer> wrapped = reader.children("integrator");
  if (!wrapped.empty()) {
    warnings.push_back(description.where.to_string() + ": integrator " + quote(description.type) +
                       " is passed over for the one within it");
    return read_integrator(*wrapped.front(), defaults, warnings);
  }
  const std::string& type = description.type;
  const bool is_replaced = type != "volpath" && type != "volpathmis" && type != "path";
  if (is_replaced)
    warnings.push_back(description.where.to_string() + ": integrator " + quote(type) +
                       " is passed over for the scene's default");
  constexpr int64_t deepest = std::numeric_limits<int32_t>::max();
  defaults.max_depth = static_cast<int32_t>(reader.integer("max_depth", defaults.max_depth, -1, deepest));
  // Where roulette begins changes how fast an image converges, not the image; files carry their exporter's
  // default, tuned for other estimators, so only a job's own setting counts here.
  reader.integer("rr_depth", defaults.rr_depth, 1, deepest);
  defaults.hide_emitters = reader.boolean("hide_emitters", defaults.hide_emitters);
  // The parameters of another integrator say nothing about this one.
  if (!is_replaced) reader.finish(&warnings);
}

}  // namespace fogbank::scene
