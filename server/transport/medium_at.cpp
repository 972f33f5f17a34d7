#include "transport/medium_at.h"

#include <array>
#include <optional>

#include "transport/world.h"

namespace fogbank::transport {

namespace {

constexpr size_t most_boundary_points = 8;
/// More surfaces than this along one ray, and the ray has found nothing: a guard against surfaces that
/// coincide.
constexpr int most_passed_surfaces = 1024;

/// No two share a plane with an axis or with a diagonal, so that rays from symmetric places don't run along
/// edges.
constexpr std::array<Vec3f, 5> directions{
    Vec3f{0.2637f, 0.9129f, 0.3114f}, Vec3f{-0.8411f, 0.1523f, 0.5190f}, Vec3f{0.4419f, -0.2871f, 0.8499f},
    Vec3f{0.7121f, 0.1877f, -0.6765f}, Vec3f{-0.3313f, -0.8623f, -0.3829f}};

/// Medium on the near side of the first boundary along a ray; nullopt when the ray meets none.
std::optional<int32_t> medium_before(const World& world, const Vec3f& origin, const Vec3f& direction) {
  const scene::Scene& scene = world.scene();
  Ray ray{origin, direction, infinity};
  for (int passed = 0; passed < most_passed_surfaces; ++passed) {
    scene::Hit hit;
    if (!scene.intersector->intersect(ray, hit)) return std::nullopt;
    const scene::SurfaceInteraction surface = scene.interaction(ray, hit);
    const scene::Shape& shape = scene.shapes[hit.shape];
    if (shape.is_medium_boundary)
      return glm::dot(direction, surface.geometric_normal) < 0 ? shape.exterior_medium
                                                               : shape.interior_medium;
    ray.origin = surface.spawn_origin(direction);
  }
  return std::nullopt;
}

/// World position of a point on a shape that is not part of a group.
Vec3f point_on(const scene::Scene& scene, const scene::Shape& shape) {
  if (shape.kind == scene::ShapeKind::triangle_mesh) {
    const scene::Mesh& mesh = scene.meshes[static_cast<size_t>(shape.mesh)];
    if (mesh.triangles.empty()) return Vec3f(0);
    const Vec3u& triangle = mesh.triangles[0];
    return 0.5f * mesh.positions[triangle.x] + 0.3f * mesh.positions[triangle.y] +
           0.2f * mesh.positions[triangle.z];
  }
  glm::dvec4 local(0.6, 0, 0.8, 1);
  if (shape.kind == scene::ShapeKind::disk) local = {0.3, 0.1, 0, 1};
  if (shape.kind == scene::ShapeKind::cylinder) local = {0.6, 0.8, 0.4, 1};
  return Vec3f(Vec3d(shape.to_world * local));
}

}  // namespace

std::vector<Vec3f> points_on_medium_boundaries(const scene::Scene& scene) {
  std::vector<Vec3f> points;
  for (const scene::Shape& shape : scene.shapes) {
    if (points.size() == most_boundary_points) break;
    if (!shape.is_medium_boundary) continue;
    if (shape.group == scene::none) {
      points.push_back(point_on(scene, shape));
      continue;
    }
    for (const scene::Instance& instance : scene.instances) {
      if (instance.group != shape.group) continue;
      points.emplace_back(Vec3d(instance.to_world * glm::dvec4(Vec3d(point_on(scene, shape)), 1.0)));
      break;
    }
  }
  return points;
}

int32_t World::medium_at(const Vec3f& x) const {
  if (boundary_points_.empty()) return scene_->sensor.medium;
  std::vector<std::pair<int32_t, int>> votes;  // (medium, rays) in order of first mention
  const auto vote = [&votes](int32_t medium) {
    for (auto& [candidate, count] : votes)
      if (candidate == medium) {
        ++count;
        return;
      }
    votes.emplace_back(medium, 1);
  };
  for (const Vec3f& direction : directions) {
    if (const std::optional<int32_t> medium = medium_before(*this, x, glm::normalize(direction)))
      vote(*medium);
  }
  if (votes.empty()) {
    for (const Vec3f& point : boundary_points_) {
      const Vec3f towards = point - x;
      const float distance = glm::length(towards);
      if (!(distance > 0)) continue;
      if (const std::optional<int32_t> medium = medium_before(*this, x, towards / distance)) vote(*medium);
    }
  }
  if (votes.empty()) return scene_->sensor.medium;
  auto best = votes.front();
  for (const auto& candidate : votes)
    if (candidate.second > best.second) best = candidate;
  return best.first;
}

}  // namespace fogbank::transport
