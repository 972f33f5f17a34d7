#include "derivatives/light_grid.h"

#include <cmath>

#include "derivatives/light_grids/kinds.h"

namespace fogbank::derivatives {

void LightGrid::clear() {
  vertices.clear();
  triangles.clear();
  round_edges.clear();
  unoccluded.clear();
  round.reset();
  at_infinity = false;
}

Vec3d LightGrid::RoundSurface::in_direction(const Vec3d& direction) const {
  // In the plane across the axis (all of space for spheres): |t d - c|^2 = radius^2.
  const Vec3d d = direction - axis * glm::dot(direction, axis);
  const Vec3d c = center - axis * glm::dot(center, axis);
  const double a = glm::dot(d, d);
  if (!(a > 0)) return direction * glm::length(center);
  const double b = glm::dot(d, c);
  const double outside = glm::dot(c, c) - radius * radius;
  const double root = std::sqrt(std::max(b * b - a * outside, 0.0));
  return direction * ((inwards ? b + root : b - root) / a);
}

Vec3d LightGrid::on_light(const Vec3d& point) const {
  if (at_infinity) return glm::normalize(point);
  return round ? round->in_direction(glm::normalize(point)) : point;
}

Vec3d LightGrid::between(const Vec3d& a, const Vec3d& b, double share) const {
  return on_light(a + (b - a) * share);
}

Vec3d LightGrid::middle(const Vec3d& a, const Vec3d& b, const Vec3d& c) const {
  return on_light((a + b + c) / 3.0);
}

namespace {

/// Null for triangles, which are gathered by mesh, and for lights without a grid.
GriddedLightPointer grid_of(const transport::Light& light, int32_t n, double least_distance) {
  const transport::LightShape shape = light.shape();
  if (const auto* rectangle = std::get_if<transport::RectangleShape>(&shape))
    return grid_rectangle(*rectangle, n, least_distance);
  if (const auto* disk = std::get_if<transport::DiskShape>(&shape))
    return grid_disk(*disk, n, least_distance);
  if (const auto* sphere = std::get_if<transport::SphereShape>(&shape))
    return grid_sphere(*sphere, n, least_distance);
  if (const auto* cylinder = std::get_if<transport::CylinderShape>(&shape))
    return grid_cylinder(*cylinder, n, least_distance);
  if (const auto* image = std::get_if<transport::ImageShape>(&shape))
    return grid_image_environment(*image, light, n);
  return nullptr;
}

}  // namespace

std::vector<PlannedLight> planned_lights(const transport::World& world, const transport::Plan& plan,
                                         int32_t n, double least_distance) {
  const auto has_grid = [&](uint32_t light) {
    return plan.treatment(light) == transport::LightTreatment::light_grid ||
           plan.treatment(light) == transport::LightTreatment::environment_grid;
  };
  std::vector<PlannedLight> planned;
  for (uint32_t i = 0; i < world.lights().size(); ++i) {
    if (!has_grid(i)) continue;
    GriddedLightPointer gridded = grid_of(world.lights().light(i), n, least_distance);
    if (gridded) planned.push_back({{i}, std::move(gridded)});
  }
  const scene::Scene& scene = world.scene();
  for (uint32_t s = 0; s < scene.shapes.size(); ++s) {
    const scene::Shape& shape = scene.shapes[s];
    if (shape.kind != scene::ShapeKind::triangle_mesh || shape.emitter == scene::none) continue;
    PlannedLight mesh;
    std::vector<transport::TriangleShape> triangles;
    const size_t primitives = scene.meshes[static_cast<size_t>(shape.mesh)].triangles.size();
    for (uint32_t p = 0; p < primitives; ++p) {
      const uint32_t light = world.light_of_hit(s, p);
      if (light == transport::SceneLights::no_light || !has_grid(light)) continue;
      const transport::LightShape light_shape = world.lights().light(light).shape();
      const auto* triangle = std::get_if<transport::TriangleShape>(&light_shape);
      if (triangle == nullptr) continue;
      mesh.lights.push_back(light);
      triangles.push_back(*triangle);
    }
    if (triangles.empty()) continue;
    mesh.gridded = grid_mesh(triangles, n);
    planned.push_back(std::move(mesh));
  }
  return planned;
}

}  // namespace fogbank::derivatives
