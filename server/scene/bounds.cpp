#include "scene/bounds.h"

#include <cmath>
#include <limits>

#include "scene/round_shape.h"

namespace fogbank::scene {
namespace {

struct Box {
  Vec3d lower{std::numeric_limits<double>::infinity()};
  Vec3d upper{-std::numeric_limits<double>::infinity()};

  bool is_empty() const { return !(lower.x <= upper.x); }
  void add(const Vec3d& point) {
    lower = glm::min(lower, point);
    upper = glm::max(upper, point);
  }
  void add(const Box& box) {
    lower = glm::min(lower, box.lower);
    upper = glm::max(upper, box.upper);
  }
};

Box shape_box(const Scene& scene, const Shape& shape) {
  Box box;
  if (shape.kind == ShapeKind::triangle_mesh) {
    for (const Vec3f& position : scene.meshes[static_cast<size_t>(shape.mesh)].positions)
      box.add(Vec3d(position));
    return box;
  }
  Vec3f lower(0);
  Vec3f upper(0);
  RoundShape(shape.kind, shape.to_world).bounds(lower, upper);
  box.add(Vec3d(lower));
  box.add(Vec3d(upper));
  return box;
}

Box transformed(const Box& box, const Mat4d& to_world) {
  Box result;
  for (int corner = 0; corner < 8; ++corner) {
    const Vec3d point((corner & 1) ? box.upper.x : box.lower.x, (corner & 2) ? box.upper.y : box.lower.y,
                      (corner & 4) ? box.upper.z : box.lower.z);
    result.add(Vec3d(to_world * glm::dvec4(point, 1.0)));
  }
  return result;
}

}  // namespace

BoundingSphere surface_bounds(const Scene& scene) {
  Box all;
  std::vector<Box> groups(static_cast<size_t>(scene.group_count));
  for (const Shape& shape : scene.shapes)
    (shape.group == none ? all : groups[static_cast<size_t>(shape.group)]).add(shape_box(scene, shape));
  for (const Instance& instance : scene.instances) {
    const Box& group = groups[static_cast<size_t>(instance.group)];
    if (!group.is_empty()) all.add(transformed(group, instance.to_world));
  }
  if (all.is_empty()) return {};
  BoundingSphere sphere;
  sphere.center = Vec3f(0.5 * (all.lower + all.upper));
  // Rounded up, so that the sphere holds the box in spite of the centre's rounding.
  const double radius = 0.5 * glm::length(all.upper - all.lower) * (1 + 1e-5);
  sphere.radius = static_cast<float>(std::max(radius, 1e-6 * (1 + glm::length(Vec3d(sphere.center)))));
  return sphere;
}

}  // namespace fogbank::scene
