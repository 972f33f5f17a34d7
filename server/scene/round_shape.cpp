#include "scene/round_shape.h"

#include <algorithm>
#include <numbers>

namespace fogbank::scene {

namespace {

constexpr double two_pi = 2 * std::numbers::pi;

/// Roots of |origin + t direction| = 1, nearer first. Written about the point of closest approach, so that a
/// far origin costs no digits (Haines et al. 2019, "Precision Improvements for Ray/Sphere Intersection").
template <class Vector>
bool unit_ball_roots(const Vector& origin, const Vector& direction, double& near, double& far) {
  const double a = glm::dot(direction, direction);
  if (!(a > 0)) return false;
  const double middle = -glm::dot(origin, direction) / a;
  const Vector closest = origin + middle * direction;
  const double discriminant = 1.0 - glm::dot(closest, closest);
  if (!(discriminant >= 0)) return false;
  const double half_chord = std::sqrt(discriminant / a);
  near = middle - half_chord;
  far = middle + half_chord;
  return true;
}

float round_down(double value) {
  return std::nextafter(std::nextafter(static_cast<float>(value), -infinity), -infinity);
}
float round_up(double value) {
  return std::nextafter(std::nextafter(static_cast<float>(value), infinity), infinity);
}

/// Azimuth of (x, y) over one turn, in [0, 1].
double turn(double x, double y) {
  const double angle = std::atan2(y, x);
  return (angle < 0 ? angle + two_pi : angle) / two_pi;
}

}  // namespace

RoundShape::RoundShape(ShapeKind kind, const Mat4d& to_world)
    : kind_(kind), to_world_(to_world), from_world_(glm::inverse(to_world)) {}

bool RoundShape::crosses_unit_shape(const Vec3d& origin, const Vec3d& direction, double distance) const {
  const Vec3d p = origin + distance * direction;
  switch (kind_) {
    case ShapeKind::disk:
      return p.x * p.x + p.y * p.y <= 1.0;
    case ShapeKind::cylinder:
      return p.z >= 0.0 && p.z <= 1.0;
    default:
      return true;
  }
}

bool RoundShape::intersect(const Vec3d& origin, const Vec3d& direction, float lower, float upper,
                           float& distance) const {
  const Vec3d o(from_world_ * glm::dvec4(origin, 1.0));
  const Vec3d d(from_world_ * glm::dvec4(direction, 0.0));
  double roots[2] = {0, 0};
  int count = 2;
  switch (kind_) {
    case ShapeKind::sphere:
      if (!unit_ball_roots(o, d, roots[0], roots[1])) return false;
      break;
    case ShapeKind::cylinder:
      if (!unit_ball_roots(Vec2d(o), Vec2d(d), roots[0], roots[1])) return false;
      break;
    default:
      if (d.z == 0.0) return false;
      roots[0] = -o.z / d.z;
      count = 1;
  }
  for (int i = 0; i < count; ++i) {
    const auto t = static_cast<float>(roots[i]);
    if (t >= lower && t <= upper && crosses_unit_shape(o, d, roots[i])) {
      distance = t;
      return true;
    }
  }
  return false;
}

void RoundShape::bounds(Vec3f& lower, Vec3f& upper) const {
  for (int axis = 0; axis < 3; ++axis) {
    const double x = to_world_[0][axis];
    const double y = to_world_[1][axis];
    const double z = to_world_[2][axis];
    const double center = to_world_[3][axis];
    const double radial = std::sqrt(x * x + y * y + (kind_ == ShapeKind::sphere ? z * z : 0.0));
    const double along = kind_ == ShapeKind::cylinder ? z : 0.0;
    lower[axis] = round_down(center - radial + std::min(along, 0.0));
    upper[axis] = round_up(center + radial + std::max(along, 0.0));
  }
}

RoundShapePoint round_shape_point(ShapeKind kind, const Vec3d& local) {
  RoundShapePoint point;
  const double radius = std::hypot(local.x, local.y);
  // On the axis the azimuth is free; zero is as good as any and keeps the derivatives finite.
  const double cos_phi = radius > 0 ? local.x / radius : 1.0;
  const double sin_phi = radius > 0 ? local.y / radius : 0.0;
  const double phi = turn(cos_phi, sin_phi);
  constexpr double smallest_radius = 1e-9;  // keeps dp_du a direction at the poles
  const Vec3d azimuthal(-sin_phi, cos_phi, 0.0);
  if (kind == ShapeKind::disk) {
    point.position = {local.x, local.y, 0.0};
    point.normal = {0, 0, 1};
    point.uv = {radius, phi};
    point.dp_du = {cos_phi, sin_phi, 0.0};
    point.dp_dv = two_pi * std::max(radius, smallest_radius) * azimuthal;
  } else if (kind == ShapeKind::cylinder) {
    point.position = {cos_phi, sin_phi, std::clamp(local.z, 0.0, 1.0)};
    point.normal = {cos_phi, sin_phi, 0.0};
    point.uv = {phi, point.position.z};
    point.dp_du = two_pi * azimuthal;
    point.dp_dv = {0, 0, 1};
  } else {
    const Vec3d p = glm::normalize(local);
    const double sin_theta = std::hypot(p.x, p.y);
    point.position = p;
    point.normal = p;
    point.uv = {phi, std::atan2(sin_theta, p.z) / std::numbers::pi};
    point.dp_du = two_pi * std::max(sin_theta, smallest_radius) * azimuthal;
    point.dp_dv = std::numbers::pi * Vec3d(p.z * cos_phi, p.z * sin_phi, -sin_theta);
  }
  return point;
}

}  // namespace fogbank::scene
