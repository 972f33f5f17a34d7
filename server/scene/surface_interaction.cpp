// From a raw hit to what shading needs, in double precision up to the final rounding, and ray origins that
// leave a surface safely.
#include <algorithm>
#include <cmath>

#include "core/frame.h"
#include "scene/intersector.h"
#include "scene/round_shape.h"
#include "scene/scene.h"

namespace fogbank::scene {

namespace {

using Mat3d = glm::dmat3;

constexpr double half_ulp = 0x1p-24;  ///< relative rounding error of one single-precision operation

/// A hit before rounding. Normals need not be unit length.
struct Point {
  Vec3d position{0};
  Vec3d geometric_normal{0, 0, 1};
  Vec3d shading_normal{0, 0, 1};
  Vec2d uv{0};
  Vec3d dp_du{1, 0, 0};
  Vec3d dp_dv{0, 1, 0};
  Vec3d error{0};  ///< per axis, of the position as the intersector sees it
};

/// Cofactor matrix of `m` times the sign of its determinant: maps normals as the inverse transpose does, up
/// to a positive factor and without a division.
Mat3d normal_matrix(const Mat3d& m) {
  const Mat3d cofactors(glm::cross(m[1], m[2]), glm::cross(m[2], m[0]), glm::cross(m[0], m[1]));
  return glm::dot(m[0], cofactors[0]) < 0 ? -cofactors : cofactors;
}

Mat3d absolute(const Mat3d& m) { return {glm::abs(m[0]), glm::abs(m[1]), glm::abs(m[2])}; }

/// How far Embree's own plane test of this triangle may be off for a ray that starts on it. It works on
/// vertices relative to the origin, v_i - o, each rounded by half an ulp, and on the cross product of their
/// differences; the normal's direction is then wrong by a few half ulps times |e1| |e2| / |e1 x e2| (large
/// for slivers), which lifts or lowers the plane by that times the distance to the vertices. The factor 2 and
/// the cap come from trials: with half the factor 6 million rays from triangles up to 1000 times as long as
/// wide hit none of their own, with an eighth of it some did (spawn_origin_test.cpp holds a smaller trial).
/// The cap keeps the offset far below a sliver's width.
double plane_test_error(const Vec3d& edge_1, const Vec3d& edge_2, double normal_length) {
  const double length_1 = glm::length(edge_1);
  const double length_2 = glm::length(edge_2);
  const double sliver = std::min(length_1 * length_2 / normal_length, 64.0);
  return 2.0 * half_ulp * sliver * std::max(length_1, length_2);
}

Point triangle_point(const Mesh& mesh, const Hit& hit, const Vec3f& ray_direction) {
  const Vec3u& triangle = mesh.triangles[hit.primitive];
  const Vec3d p0(mesh.positions[triangle.x]);
  const Vec3d edge_1 = Vec3d(mesh.positions[triangle.y]) - p0;
  const Vec3d edge_2 = Vec3d(mesh.positions[triangle.z]) - p0;
  const double b1 = hit.parameters.x;
  const double b2 = hit.parameters.y;
  const double b0 = 1.0 - b1 - b2;

  Point point;
  point.position = p0 + b1 * edge_1 + b2 * edge_2;
  point.geometric_normal = glm::cross(edge_1, edge_2);
  const double normal_length = glm::length(point.geometric_normal);
  // Readers drop triangles without area, but rounding under `to_world` may make some, and no NaN shall come
  // of it.
  if (!(normal_length > 0)) point.geometric_normal = -Vec3d(ray_direction);
  point.error = Vec3d(plane_test_error(edge_1, edge_2, normal_length));

  point.shading_normal = point.geometric_normal;
  if (!mesh.normals.empty()) {
    const Vec3d blended = b0 * Vec3d(mesh.normals[triangle.x]) + b1 * Vec3d(mesh.normals[triangle.y]) +
                          b2 * Vec3d(mesh.normals[triangle.z]);
    // Opposite vertex normals can cancel out; the face's normal is the only direction left then.
    if (glm::dot(blended, blended) > 1e-12) point.shading_normal = blended;
  }

  if (mesh.uvs.empty()) {
    point.uv = {b1, b2};
    point.dp_du = edge_1;
    point.dp_dv = edge_2;
    return point;
  }
  const Vec2d uv0(mesh.uvs[triangle.x]);
  const Vec2d duv_1 = Vec2d(mesh.uvs[triangle.y]) - uv0;
  const Vec2d duv_2 = Vec2d(mesh.uvs[triangle.z]) - uv0;
  point.uv = uv0 + b1 * duv_1 + b2 * duv_2;
  const double determinant = duv_1.x * duv_2.y - duv_1.y * duv_2.x;
  point.dp_du = (duv_2.y * edge_1 - duv_1.y * edge_2) / determinant;
  point.dp_dv = (duv_1.x * edge_2 - duv_2.x * edge_1) / determinant;
  constexpr double longest = 1e18;  // squares of it are still finite in single precision
  if (!(glm::length(point.dp_du) < longest && glm::length(point.dp_dv) < longest)) {
    const Frame frame = Frame::from_normal(Vec3f(glm::normalize(point.geometric_normal)));
    point.dp_du = frame.tangent;
    point.dp_dv = frame.bitangent;
  }
  return point;
}

/// `ray` is in the space that `to_world` leads to.
Point round_point(const Shape& shape, const Ray& ray, double distance) {
  const Vec3d near_surface = Vec3d(ray.origin) + distance * Vec3d(ray.direction);
  const Vec3d local(glm::inverse(shape.to_world) * glm::dvec4(near_surface, 1.0));
  const RoundShapePoint on_shape = round_shape_point(shape.kind, local);
  const Mat3d linear(shape.to_world);
  Point point;
  point.position = Vec3d(shape.to_world * glm::dvec4(on_shape.position, 1.0));
  point.geometric_normal = normal_matrix(linear) * on_shape.normal;
  // Mitsuba 3.9.1 turns a sphere with a mirroring `to_world` inside out, but no disk, cylinder or instance.
  if (shape.kind == ShapeKind::sphere && glm::determinant(linear) < 0)
    point.geometric_normal = -point.geometric_normal;
  point.shading_normal = point.geometric_normal;
  point.uv = on_shape.uv;
  point.dp_du = linear * on_shape.dp_du;
  point.dp_dv = linear * on_shape.dp_dv;
  return point;
}

Ray to_instance_space(const Ray& ray, const Mat4d& to_world) {
  const Mat4d from_world = glm::inverse(to_world);
  Ray local;
  local.origin = Vec3f(from_world * glm::dvec4(Vec3d(ray.origin), 1.0));
  local.direction =
      Vec3f(from_world * glm::dvec4(Vec3d(ray.direction), 0.0));  // not unit length: keeps distances
  return local;
}

void place(Point& point, const Mat4d& to_world) {
  const Mat3d linear(to_world);
  const Mat3d for_normals = normal_matrix(linear);
  point.position = Vec3d(to_world * glm::dvec4(point.position, 1.0));
  point.geometric_normal = for_normals * point.geometric_normal;
  point.shading_normal = for_normals * point.shading_normal;
  point.dp_du = linear * point.dp_du;
  point.dp_dv = linear * point.dp_dv;
  // Embree carries the ray into the instance's space in single precision: four roundings each of |A^-1| (|p|
  // + |translation|), brought back to world space by |A|.
  const Mat3d world = absolute(linear);
  const Vec3d carried = glm::abs(point.position) + glm::abs(Vec3d(to_world[3]));
  point.error = world * point.error + 4.0 * half_ulp * (world * (absolute(glm::inverse(linear)) * carried));
}

}  // namespace

SurfaceInteraction Scene::interaction(const Ray& ray, const Hit& hit) const {
  const Shape& shape = shapes[hit.shape];
  const Instance* instance = hit.instance == none ? nullptr : &instances[static_cast<size_t>(hit.instance)];
  Point point;
  if (shape.kind == ShapeKind::triangle_mesh) {
    point = triangle_point(meshes[static_cast<size_t>(shape.mesh)], hit, ray.direction);
  } else {
    point = round_point(shape, instance != nullptr ? to_instance_space(ray, instance->to_world) : ray,
                        hit.distance);
  }
  if (instance != nullptr) place(point, instance->to_world);

  const double side = shape.flip_normals ? -1.0 : 1.0;
  SurfaceInteraction surface;
  surface.distance = hit.distance;
  surface.position = Vec3f(point.position);
  surface.position_error = Vec3f(point.error + 2.0 * half_ulp * glm::abs(point.position));
  surface.geometric_normal = Vec3f(side * glm::normalize(point.geometric_normal));
  surface.shading_normal = Vec3f(side * glm::normalize(point.shading_normal));
  surface.uv = Vec2f(point.uv);
  surface.dp_du = Vec3f(point.dp_du);
  surface.dp_dv = Vec3f(point.dp_dv);
  surface.shape = hit.shape;
  surface.primitive = hit.primitive;
  return surface;
}

Vec3f SurfaceInteraction::spawn_origin(const Vec3f& direction) const {
  // The offset of Pharr et al. 2023, "Physically Based Rendering" (4th ed.), section 6.8.6: far enough along
  // the normal to leave the box of the error, then each coordinate rounded away from the surface.
  const Vec3f normal = glm::dot(direction, geometric_normal) < 0 ? -geometric_normal : geometric_normal;
  const float clearance = glm::dot(glm::abs(normal), position_error);
  const Vec3f offset = clearance * normal;
  Vec3f origin = position + offset;
  for (int axis = 0; axis < 3; ++axis) {
    if (offset[axis] > 0) origin[axis] = std::nextafter(origin[axis], infinity);
    if (offset[axis] < 0) origin[axis] = std::nextafter(origin[axis], -infinity);
  }
  return origin;
}

}  // namespace fogbank::scene
