// `<shape>` elements: the part of SceneBuilder that makes shapes, groups and instances.
#include <algorithm>
#include <array>
#include <cmath>
#include <glm/gtc/matrix_transform.hpp>

#include "core/frame.h"
#include "scene/loader.h"
#include "scene/mesh_normals.h"
#include "scene/mesh_readers.h"
#include "scene/scene_builder.h"
#include "scene/tessellation.h"
#include "scene/text.h"

namespace fogbank::scene {
namespace {

constexpr double largest_coordinate = LoadLimits::coordinate;
/// Densities per area are floats: their reciprocal must stay far from infinity.
constexpr double smallest_light_area = 1e-30;

const std::vector<std::string>& shape_types() {
  static const std::vector<std::string> types = {"cube", "cylinder",  "disk",       "instance",   "obj",
                                                 "ply",  "rectangle", "serialized", "shapegroup", "sphere"};
  return types;
}

Mat4d sphere_to_world(PropertyReader& reader) {
  const Vec3d center = reader.vector("center", Vec3d(0));
  const double radius = reader.number("radius", 1.0, 1e-15, largest_coordinate);
  return glm::scale(glm::translate(Mat4d(1.0), center), Vec3d(radius));
}

Mat4d cylinder_to_world(PropertyReader& reader) {
  const Vec3d p0 = reader.vector("p0", Vec3d(0));
  const Vec3d p1 = reader.vector("p1", Vec3d(0, 0, 1));
  const double radius = reader.number("radius", 1.0, 1e-15, largest_coordinate);
  const double length = glm::length(p1 - p0);
  if (!(length > 0)) reader.fail("OUT_OF_RANGE", "'p0' and 'p1' coincide");
  const Frame frame = Frame::from_normal(Vec3f((p1 - p0) / length));
  const Vec3d axis = (p1 - p0) / length;
  // The frame is in single precision; its tangents are made orthogonal to the axis again.
  const Vec3d tangent = glm::normalize(Vec3d(frame.tangent) - axis * glm::dot(axis, Vec3d(frame.tangent)));
  const Vec3d bitangent = glm::cross(axis, tangent);
  return {glm::dvec4(radius * tangent, 0), glm::dvec4(radius * bitangent, 0), glm::dvec4(length * axis, 0),
          glm::dvec4(p0, 1)};
}

void check_extent(const PropertyReader& reader, const Vec3d& position) {
  const Vec3d size = glm::abs(position);
  if (!(std::max({size.x, size.y, size.z}) <= largest_coordinate))
    reader.fail("COORDINATE_TOO_LARGE", "the shape extends beyond " + number_text(largest_coordinate));
}

/// Of a round shape: centre and half axes.
void check_extent(const PropertyReader& reader, const Mat4d& to_world) {
  for (int column = 0; column < 4; ++column) check_extent(reader, Vec3d(to_world[column]));
}

/// Spheres stay spheres and cylinders stay round and straight.
void check_similarity(const PropertyReader& reader, const Mat4d& to_world, bool is_sphere) {
  const glm::dmat3 m(to_world);
  const std::array<double, 3> lengths = {glm::length(m[0]), glm::length(m[1]), glm::length(m[2])};
  // Matrices come with 6 digits or so from exporters.
  constexpr double tolerance = 1e-4;
  const auto is_orthogonal = [&](int a, int b) {
    return std::abs(glm::dot(m[a], m[b])) <=
           tolerance * lengths[static_cast<size_t>(a)] * lengths[static_cast<size_t>(b)];
  };
  const bool is_round = std::abs(lengths[0] - lengths[1]) <= tolerance * lengths[0] && is_orthogonal(0, 1) &&
                        is_orthogonal(0, 2) && is_orthogonal(1, 2);
  const bool is_uniform = std::abs(lengths[0] - lengths[2]) <= tolerance * lengths[0];
  if (is_round && (is_uniform || !is_sphere)) return;
  reader.fail("INVALID_TRANSFORM",
              is_sphere ? "'to_world' must scale a sphere uniformly; use a mesh for an ellipsoid"
                        : "'to_world' must keep a cylinder round and straight; use a mesh");
}

}  // namespace

void SceneBuilder::add_shape(const ObjectPointer& description) {
  if (description->type == "shapegroup")
    group(description);
  else if (description->type == "instance")
    add_instance(description);
  else
    add_surface(description, none);
}

int32_t SceneBuilder::group(const ObjectPointer& description) {
  if (const auto known = groups_.find(description); known != groups_.end()) return known->second;
  const int32_t index = scene_.group_count++;
  groups_[description] = index;
  PropertyReader reader(*description);
  const std::vector<ObjectPointer> members = reader.children("shape");
  if (members.empty()) reader.fail("EMPTY_GROUP", "a shapegroup needs at least one <shape>");
  for (const ObjectPointer& member : members) {
    if (member->type == "shapegroup" || member->type == "instance")
      throw SceneError(ErrorKind::unsupported, "NESTED_INSTANCES_UNSUPPORTED", member->where,
                       "instances within a shapegroup are not supported");
    add_surface(member, index);
  }
  reader.finish(lenient_warnings());
  return index;
}

void SceneBuilder::add_instance(const ObjectPointer& description) {
  PropertyReader reader(*description);
  const std::vector<ObjectPointer> groups = reader.children("shape");
  if (groups.size() != 1 || groups.front()->type != "shapegroup")
    reader.fail("MISSING_PARAMETER", "an instance needs one reference to a shapegroup");
  Instance instance;
  instance.to_world = reader.transform("to_world");
  instance.group = group(groups.front());
  reader.finish(lenient_warnings());
  scene_.instances.push_back(instance);
}

double SceneBuilder::light_area(const Shape& shape) const {
  constexpr double pi_exactly = 3.14159265358979323846;
  const glm::dmat3 m(shape.to_world);
  switch (shape.kind) {
    case ShapeKind::triangle_mesh:
      return surface_area(scene_.meshes[static_cast<size_t>(shape.mesh)]);
    case ShapeKind::sphere:
      return 4 * pi_exactly * glm::dot(m[0], m[0]);
    case ShapeKind::disk:
      return pi_exactly * glm::length(glm::cross(m[0], m[1]));
    case ShapeKind::cylinder:
      return 2 * pi_exactly * glm::length(m[0]) * glm::length(m[2]);
  }
  return 0;
}

void SceneBuilder::add_surface(const ObjectPointer& description, int32_t group) {
  const std::vector<std::string>& types = shape_types();
  if (std::find(types.begin(), types.end(), description->type) == types.end())
    return unknown_plugin(*description, types, "is left out");
  PropertyReader reader(*description);
  Shape shape;
  shape.id = description->id;
  shape.where = description->where;
  shape.group = group;
  shape.flip_normals = reader.boolean("flip_normals", false);
  const Mat4d to_world = reader.transform("to_world");
  const std::string& type = description->type;
  if (type == "sphere") {
    shape.kind = ShapeKind::sphere;
    shape.to_world = to_world * sphere_to_world(reader);
    check_similarity(reader, shape.to_world, true);
  } else if (type == "disk") {
    shape.kind = ShapeKind::disk;
    shape.to_world = to_world;
  } else if (type == "cylinder") {
    shape.kind = ShapeKind::cylinder;
    shape.to_world = to_world * cylinder_to_world(reader);
    check_similarity(reader, shape.to_world, false);
  } else {
    shape.mesh = add_mesh(reader, to_world);
  }
  check_extent(reader, shape.to_world);

  const std::vector<ObjectPointer> bsdfs = reader.children("bsdf");
  if (bsdfs.size() > 1) reader.fail("DUPLICATE_PARAMETER", "a shape has one <bsdf>");
  shape.bsdf = bsdfs.empty() ? default_bsdf(!reader.children("emitter").empty()) : bsdf(bsdfs.front());
  shape.passes_light = !bsdfs.empty() && passes_light(bsdfs.front());

  if (const ObjectPointer interior = reader.child("interior", "medium"))
    shape.interior_medium = medium(interior);
  if (const ObjectPointer exterior = reader.child("exterior", "medium"))
    shape.exterior_medium = medium(exterior);
  shape.is_medium_boundary = shape.interior_medium != none || shape.exterior_medium != none;

  const std::vector<ObjectPointer> emitters = reader.children("emitter");
  if (emitters.size() > 1) reader.fail("DUPLICATE_PARAMETER", "a shape has one <emitter>");
  if (!emitters.empty()) {
    if (group != none)
      throw SceneError(ErrorKind::unsupported, "INSTANCED_EMITTER_UNSUPPORTED", emitters.front()->where,
                       "shapes in a shapegroup can't be lights");
    if (!(light_area(shape) > smallest_light_area))
      reader.fail("ZERO_AREA_LIGHT", "the shape is a light and has (almost) no area");
    // One entry per shape: lights that share a description are still several lights.
    shape.emitter = static_cast<int32_t>(scene_.emitters.size());
    scene_.emitters.push_back(emitters.front());
    shape_emitters_.emplace(emitters.front(), shape.emitter);
  }
  reader.finish(lenient_warnings());
  scene_.shapes.push_back(std::move(shape));
}

int32_t SceneBuilder::add_mesh(PropertyReader& reader, const Mat4d& to_world) {
  const std::string& type = reader.object().type;
  Mesh mesh;
  if (type == "rectangle")
    mesh = rectangle_mesh();
  else if (type == "cube")
    mesh = cube_mesh();
  else
    mesh = read_mesh_file(reader);
  if (mesh.dropped_triangles > 0)
    scene_.warnings.push_back(reader.object().where.to_string() + ": " +
                              std::to_string(mesh.dropped_triangles) + " of " +
                              std::to_string(mesh.dropped_triangles + mesh.triangles.size()) +
                              " triangles have no area and are left out");
  triangle_count_ += mesh.triangles.size();
  if (triangle_count_ > LoadLimits::triangles)
    throw SceneError(ErrorKind::resource_exhausted, "TOO_MANY_TRIANGLES", reader.object().where,
                     "the scene has more than " + std::to_string(LoadLimits::triangles) + " triangles");
  transform_mesh(mesh, to_world);
  complete_vertex_normals(mesh);
  for (const Vec3f& position : mesh.positions) check_extent(reader, Vec3d(position));
  scene_.meshes.push_back(std::move(mesh));
  return static_cast<int32_t>(scene_.meshes.size()) - 1;
}

Mesh SceneBuilder::read_mesh_file(PropertyReader& reader) {
  const ObjectDescription& object = reader.object();
  if (!reader.has("filename")) reader.fail("MISSING_PARAMETER", "parameter 'filename' is missing");
  MeshFileRequest request;
  request.type = object.type;
  MeshReadOptions& options = request.options;
  options.path = reader.text("filename", "");
  options.face_normals = reader.boolean("face_normals", false);
  options.flip_tex_coords = reader.boolean("flip_tex_coords", object.type == "obj");
  options.max_smooth_angle_degrees = reader.number_if_given("max_smooth_angle", 0.0, 180.0);
  if (object.type == "serialized")
    request.shape_index = reader.integer("shape_index", 0, 0, std::numeric_limits<int32_t>::max());
  return files_.mesh(request, object.where);
}

}  // namespace fogbank::scene
