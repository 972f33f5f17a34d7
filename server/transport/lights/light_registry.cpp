#include "transport/lights/light_registry.h"

#include <algorithm>
#include <array>
#include <functional>
#include <limits>
#include <map>

#include "transport/lights/delta_lights.h"
#include "transport/lights/environment_lights.h"
#include "transport/lights/polygon_lights.h"
#include "transport/lights/round_lights.h"

namespace fogbank::transport {

namespace {

using scene::PropertyReader;

constexpr float most_radiance = std::numeric_limits<float>::max();

Vec3f transform_point(const Mat4d& m, const Vec3d& p) { return Vec3f(Vec3d(m * glm::dvec4(p, 1.0))); }
Vec3f transform_vector(const Mat4d& m, const Vec3d& v) { return Vec3f(Vec3d(m * glm::dvec4(v, 0.0))); }

Vec3f unit_or_fail(const PropertyReader& reader, const Vec3d& v, const char* what) {
  const double length = glm::length(v);
  if (!(length > 0)) reader.fail("ZERO_DIRECTION", std::string(what) + " has no length");
  return Vec3f(v / length);
}

LightPointer make_point(PropertyReader& reader, scene::Scene&) {
  const Mat4d to_world = reader.transform("to_world");
  const Vec3d position =
      reader.has("position") ? reader.vector("position", Vec3d(0)) : Vec3d(to_world * glm::dvec4(0, 0, 0, 1));
  return std::make_unique<PointLight>(Vec3f(position),
                                      reader.spectrum("intensity", Spectrum(1), 0, most_radiance));
}

LightPointer make_spot(PropertyReader& reader, scene::Scene&) {
  const Mat4d to_world = reader.transform("to_world");
  const Spectrum intensity = reader.spectrum("intensity", Spectrum(1), 0, most_radiance);
  const double cutoff = reader.number("cutoff_angle", 20, 1e-3, 180);
  const double beam = reader.number("beam_width", 0.75 * cutoff, 0, cutoff);
  if (reader.has("texture"))
    reader.fail_at("texture", "UNSUPPORTED_PARAMETER", "textured spot lights are not supported");
  const Vec3f axis =
      unit_or_fail(reader, Vec3d(to_world * glm::dvec4(0, 0, 1, 0)), "the direction of the spot light");
  return std::make_unique<SpotLight>(transform_point(to_world, Vec3d(0)), axis, intensity,
                                     static_cast<float>(glm::radians(cutoff)),
                                     static_cast<float>(glm::radians(beam)));
}

LightPointer make_directional(PropertyReader& reader, scene::Scene&) {
  const Mat4d to_world = reader.transform("to_world");
  const Vec3d direction = reader.has("direction") ? reader.vector("direction", Vec3d(0, 0, 1))
                                                  : Vec3d(to_world * glm::dvec4(0, 0, 1, 0));
  return std::make_unique<DirectionalLight>(
      unit_or_fail(reader, direction, "the direction of the directional light"),
      reader.spectrum("irradiance", Spectrum(1), 0, most_radiance));
}

LightPointer make_constant(PropertyReader& reader, scene::Scene&) {
  return std::make_unique<ConstantLight>(reader.spectrum("radiance", Spectrum(1), 0, most_radiance));
}

LightPointer make_environment(PropertyReader& reader, scene::Scene& scene) {
  const std::string filename = reader.text("filename", "");
  if (filename.empty()) reader.fail("MISSING_PARAMETER", "an envmap needs a `filename`");
  scene::ImagePointer image = scene.textures->image(filename, false, reader.object().where);
  if (image->width < 2 || image->height < 2)
    reader.fail_at("filename", "IMAGE_TOO_SMALL", "an envmap needs at least 2 x 2 pixels");
  if (image->lowest < 0) reader.fail_at("filename", "NEGATIVE_RADIANCE", "the image has negative values");
  return std::make_unique<EnvironmentLight>(std::move(image), reader.transform("to_world"),
                                            static_cast<float>(reader.number("scale", 1, 0, most_radiance)));
}

using Factory = LightPointer (*)(PropertyReader&, scene::Scene&);

/// Emitters that stand for themselves. `area` is not among them: it belongs to a shape.
const std::map<std::string, Factory>& factories() {
  static const std::map<std::string, Factory> table{
      {"constant", make_constant},  {"directional", make_directional},
      {"envmap", make_environment}, {"point", make_point},
      {"spot", make_spot},
  };
  return table;
}

std::string list_supported() {
  std::string text;
  for (const std::string& name : supported_emitters()) text += (text.empty() ? "" : ", ") + name;
  return text;
}

/// The scene's own lights of one emissive shape.
class ShapeLights {
 public:
  ShapeLights(const scene::Scene& scene, uint32_t shape, scene::TexturePointer radiance, SceneLights& lights)
      : scene_(scene),
        shape_(scene.shapes[shape]),
        index_(shape),
        radiance_(std::move(radiance)),
        lights_(lights) {}

  void add() {
    lights_.first_of_shape[index_] = static_cast<uint32_t>(lights_.lights.size());
    switch (shape_.kind) {
      case scene::ShapeKind::triangle_mesh:
        if (!add_rectangle()) add_triangles();
        break;
      case scene::ShapeKind::sphere:
        add_sphere();
        break;
      case scene::ShapeKind::disk:
        push(std::make_unique<DiskLight>(transform_point(shape_.to_world, Vec3d(0)),
                                         transform_vector(shape_.to_world, {1, 0, 0}),
                                         transform_vector(shape_.to_world, {0, 1, 0}), flipped(), radiance_));
        break;
      case scene::ShapeKind::cylinder:
        push(std::make_unique<CylinderLight>(
            transform_point(shape_.to_world, Vec3d(0)), transform_point(shape_.to_world, {0, 0, 1}),
            transform_vector(shape_.to_world, {1, 0, 0}), shape_.flip_normals,
            glm::determinant(glm::dmat3(shape_.to_world)) < 0, radiance_));
        break;
    }
  }

 private:
  bool flipped() const { return shape_.flip_normals; }

  void push(LightPointer light) {
    if (!(light->bounds().intensity >= 0) || !std::isfinite(light->bounds().intensity) ||
        !is_finite(light->bounds().axis))
      throw SceneError(ErrorKind::invalid_argument, "ZERO_AREA_LIGHT", shape_.where,
                       "the emitting shape has no area, or its power is not finite");
    lights_.lights.push_back(std::move(light));
  }

  void add_sphere() {
    const Vec3f center = transform_point(shape_.to_world, Vec3d(0));
    const auto radius = static_cast<float>(glm::length(Vec3d(shape_.to_world[0])));
    push(std::make_unique<SphereLight>(center, radius, shape_.flip_normals, glm::inverse(shape_.to_world),
                                       radiance_));
  }

  /// Two triangles that make a rectangle are one light: half the shadow rays' noise, and a cheaper solid
  /// angle.
  bool add_rectangle() {
    const scene::Mesh& mesh = scene_.meshes[static_cast<size_t>(shape_.mesh)];
    if (mesh.triangles.size() != 2 || mesh.positions.size() != 4) return false;
    const Vec3u first = mesh.triangles[0];
    const Vec3u second = mesh.triangles[1];
    // The vertex of the first triangle that the second does not share is the corner opposite to the diagonal.
    int own = -1;
    for (int i = 0; i < 3; ++i) {
      if (first[i] != second.x && first[i] != second.y && first[i] != second.z) {
        if (own != -1) return false;
        own = i;
      }
    }
    if (own == -1) return false;
    const uint32_t corner = first[own];
    const uint32_t along = first[(own + 1) % 3];
    const uint32_t across = first[(own + 2) % 3];
    const uint32_t opposite = 6 - corner - along - across;
    const auto position = [&](uint32_t i) { return mesh.positions[i]; };
    Vec3f edge_x = position(along) - position(corner);
    Vec3f edge_y = position(across) - position(corner);
    const float size = glm::length(edge_x) + glm::length(edge_y);
    if (glm::length(position(corner) + edge_x + edge_y - position(opposite)) > 1e-5f * size) return false;
    if (std::fabs(glm::dot(edge_x, edge_y)) > 1e-5f * glm::length(edge_x) * glm::length(edge_y)) return false;
    const auto uv = [&](uint32_t i) { return mesh.uvs.empty() ? Vec2f(0) : mesh.uvs[i]; };
    if (!mesh.uvs.empty() && glm::length(uv(corner) + uv(opposite) - uv(along) - uv(across)) > 1e-5f)
      return false;
    std::array<Vec2f, 3> uvs{uv(corner), uv(along), uv(across)};
    if (flipped()) {
      std::swap(edge_x, edge_y);
      std::swap(uvs[1], uvs[2]);
    }
    push(std::make_unique<RectangleLight>(position(corner), edge_x, edge_y, uvs, radiance_));
    return true;
  }

  void add_triangles() {
    const scene::Mesh& mesh = scene_.meshes[static_cast<size_t>(shape_.mesh)];
    std::vector<uint32_t>& of_primitive = lights_.of_primitive[index_];
    of_primitive.assign(mesh.triangles.size(), SceneLights::no_light);
    bool any = false;
    for (size_t i = 0; i < mesh.triangles.size(); ++i) {
      Vec3u t = mesh.triangles[i];
      if (flipped()) std::swap(t.y, t.z);
      const std::array<Vec3f, 3> vertices{mesh.positions[t.x], mesh.positions[t.y], mesh.positions[t.z]};
      const float area = glm::length(glm::cross(vertices[1] - vertices[0], vertices[2] - vertices[0]));
      if (!(area > 0)) continue;
      std::array<Vec2f, 3> uvs{Vec2f(0), Vec2f(1, 0), Vec2f(0, 1)};
      if (!mesh.uvs.empty()) uvs = {mesh.uvs[t.x], mesh.uvs[t.y], mesh.uvs[t.z]};
      of_primitive[i] = static_cast<uint32_t>(lights_.lights.size());
      push(std::make_unique<TriangleLight>(vertices, uvs, radiance_));
      any = true;
    }
    if (!any)
      throw SceneError(ErrorKind::invalid_argument, "ZERO_AREA_LIGHT", shape_.where,
                       "the emitting shape has no area");
  }

  const scene::Scene& scene_;
  const scene::Shape& shape_;
  uint32_t index_;
  scene::TexturePointer radiance_;
  SceneLights& lights_;
};

}  // namespace

std::vector<std::string> supported_emitters() {
  std::vector<std::string> names{"area"};
  for (const auto& [name, factory] : factories()) names.push_back(name);
  std::sort(names.begin(), names.end());
  return names;
}

SceneLights build_lights(scene::Scene& scene) {
  SceneLights result;
  result.first_of_shape.assign(scene.shapes.size(), SceneLights::no_light);
  result.of_primitive.resize(scene.shapes.size());
  std::vector<std::string>* warnings = scene.lenient ? &scene.warnings : nullptr;

  std::vector<bool> on_shape(scene.emitters.size(), false);
  std::vector<scene::TexturePointer> radiance(scene.emitters.size());
  for (uint32_t i = 0; i < scene.shapes.size(); ++i) {
    const scene::Shape& shape = scene.shapes[i];
    if (shape.emitter == scene::none) continue;
    const auto emitter = static_cast<size_t>(shape.emitter);
    const scene::ObjectDescription& object = *scene.emitters[emitter];
    if (object.type != "area") {
      const std::string message = "a shape can only carry an emitter of type area, not " + object.type;
      if (warnings == nullptr)
        throw SceneError(ErrorKind::invalid_argument, "UNKNOWN_EMITTER", object.where, message);
      warnings->push_back(object.where.to_string() + ": " + message + "; dropped");
      on_shape[emitter] = true;
      continue;
    }
    if (shape.group != scene::none)
      throw SceneError(ErrorKind::unsupported, "EMITTER_IN_SHAPE_GROUP", object.where,
                       "shapes within a shapegroup can't emit light");
    if (!on_shape[emitter]) {
      PropertyReader reader(object);
      radiance[emitter] =
          scene::read_texture(reader, "radiance", Spectrum(1), 0, most_radiance, *scene.textures);
      reader.number("sampling_weight", 1, 0, most_radiance);
      reader.finish(warnings);
      on_shape[emitter] = true;
    }
    ShapeLights(scene, i, radiance[emitter], result).add();
  }

  int environments = 0;
  for (size_t i = 0; i < scene.emitters.size(); ++i) {
    if (on_shape[i]) continue;
    const scene::ObjectDescription& object = *scene.emitters[i];
    const auto factory = factories().find(object.type);
    if (factory == factories().end()) {
      const std::string message =
          object.type == "area"
              ? "an area emitter must stand inside a shape"
              : object.type + " is not an emitter Fogbank knows; supported: " + list_supported();
      if (warnings == nullptr)
        throw SceneError(ErrorKind::invalid_argument, "UNKNOWN_EMITTER", object.where, message);
      warnings->push_back(object.where.to_string() + ": " + message + "; dropped");
      continue;
    }
    PropertyReader reader(object);
    LightPointer light = factory->second(reader, scene);
    reader.number("sampling_weight", 1, 0, most_radiance);
    reader.finish(warnings);
    if (light->at_infinity() && !light->is_delta() && ++environments > 1)
      throw SceneError(ErrorKind::invalid_argument, "SECOND_ENVIRONMENT", object.where,
                       "a scene can have only one constant or envmap emitter");
    result.lights.push_back(std::move(light));
  }
  return result;
}

}  // namespace fogbank::transport
