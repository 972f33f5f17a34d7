#include "derivatives/light_surface.h"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace fogbank::derivatives {

namespace {

using std::numbers::pi;

Vec3d unit(const Vec3d& v) {
  const double length = glm::length(v);
  return length > 0 ? v / length : Vec3d(0);
}

struct NormalAt {
  Vec3d y;

  Vec3d operator()(const transport::RectangleShape& shape) const {
    return unit(glm::cross(Vec3d(shape.edge_x), Vec3d(shape.edge_y)));
  }
  Vec3d operator()(const transport::TriangleShape& shape) const {
    return unit(glm::cross(Vec3d(shape.vertices[1]) - Vec3d(shape.vertices[0]),
                           Vec3d(shape.vertices[2]) - Vec3d(shape.vertices[0])));
  }
  Vec3d operator()(const transport::SphereShape& shape) const { return unit(y - Vec3d(shape.center)); }
  Vec3d operator()(const transport::DiskShape& shape) const { return Vec3d(shape.normal); }
  Vec3d operator()(const transport::CylinderShape& shape) const {
    const Vec3d from_base = y - Vec3d(shape.base);
    return unit(from_base - Vec3d(shape.axis) * glm::dot(from_base, Vec3d(shape.axis)));
  }
  template <typename Other>
  Vec3d operator()(const Other&) const {
    return Vec3d(0);
  }
};

Vec2f blend(const std::array<Vec2f, 3>& uvs, double along, double across) {
  return uvs[0] + static_cast<float>(along) * (uvs[1] - uvs[0]) +
         static_cast<float>(across) * (uvs[2] - uvs[0]);
}

/// Two unit vectors that make a right-handed frame with the unit vector `w`.
std::array<Vec3d, 2> frame_around(const Vec3d& w) {
  const Vec3d other = std::fabs(w.x) < 0.7 ? Vec3d(1, 0, 0) : Vec3d(0, 1, 0);
  const Vec3d tangent = unit(glm::cross(other, w));
  return {tangent, glm::cross(w, tangent)};
}

struct PatchFor {
  using Patch = std::optional<LightPatch>;

  Vec3d x;

  bool faces(const Vec3d& point, const Vec3d& normal) const { return glm::dot(x - point, normal) > 0; }

  Patch operator()(const transport::RectangleShape& shape) const {
    const Vec3d corner(shape.corner);
    const Vec3d edge_x(shape.edge_x);
    const Vec3d edge_y(shape.edge_y);
    const Vec3d normal = unit(glm::cross(edge_x, edge_y));
    if (!faces(corner, normal)) return std::nullopt;
    const double area = glm::length(glm::cross(edge_x, edge_y));
    return LightPatch{[=](double u, double v) {
                        return LightPoint{corner + u * edge_x + v * edge_y, normal, area,
                                          shape.radiance->evaluate(blend(shape.uvs, u, v))};
                      },
                      glm::length(edge_x), glm::length(edge_y)};
  }

  /// v runs from the first vertex to the edge opposite, u along lines parallel to it.
  Patch operator()(const transport::TriangleShape& shape) const {
    const Vec3d p(shape.vertices[0]);
    const Vec3d e1 = Vec3d(shape.vertices[1]) - p;
    const Vec3d e2 = Vec3d(shape.vertices[2]) - p;
    const Vec3d cross = glm::cross(e1, e2);
    if (!faces(p, cross)) return std::nullopt;
    const Vec3d normal = unit(cross);
    const double area = glm::length(cross);
    return LightPatch{[=](double u, double v) {
                        const double b1 = v * (1 - u);
                        const double b2 = v * u;
                        return LightPoint{p + b1 * e1 + b2 * e2, normal, area * v,
                                          shape.radiance->evaluate(blend(shape.uvs, b1, b2))};
                      },
                      glm::length(e2 - e1), std::max(glm::length(e1), glm::length(e2))};
  }

  /// From outside the cap that faces x, by polar angle (v) and azimuth (u) about the direction to x; from
  /// inside of one that emits inwards all of it.
  Patch operator()(const transport::SphereShape& shape) const {
    const Vec3d center(shape.center);
    const double radius = shape.radius;
    const double distance = glm::length(x - center);
    const bool inside = distance < radius;
    if (inside != shape.inwards) return std::nullopt;
    const Vec3d axis = distance > 0 ? (x - center) / distance : Vec3d(0, 0, 1);
    const std::array<Vec3d, 2> tangents = frame_around(axis);
    // 1 - cos of the cap's polar angle; cos = radius / distance at the horizon.
    const double height = inside ? 2 : 1 - radius / distance;
    const glm::dmat3 to_local(shape.to_local);
    return LightPatch{
        [=](double u, double v) {
          const double one_minus_cosine = v * height;
          const double sine = std::sqrt(one_minus_cosine * (2 - one_minus_cosine));
          const Vec3d outward = axis * (1 - one_minus_cosine) + sine * (std::cos(2 * pi * u) * tangents[0] +
                                                                        std::sin(2 * pi * u) * tangents[1]);
          const Vec3d local = to_local * outward;
          const double azimuth = std::atan2(local.y, local.x) / (2 * pi);
          const Vec2d uv(azimuth < 0 ? azimuth + 1 : azimuth, std::acos(std::clamp(local.z, -1.0, 1.0)) / pi);
          return LightPoint{center + radius * outward, shape.inwards ? -outward : outward,
                            2 * pi * radius * radius * height, shape.radiance->evaluate(Vec2f(uv))};
        },
        2 * pi * radius * std::sqrt(std::min(height, 1.0)), 2 * radius * std::sqrt(height)};
  }

  /// Chords (v) of the unit disk at the sine of an angle, which keeps their ends' square root smooth.
  Patch operator()(const transport::DiskShape& shape) const {
    const Vec3d center(shape.center);
    const Vec3d axis_x(shape.axis_x);
    const Vec3d axis_y(shape.axis_y);
    const Vec3d normal(shape.normal);
    if (!faces(center, normal)) return std::nullopt;
    const double area = glm::length(glm::cross(axis_x, axis_y));
    return LightPatch{[=](double u, double v) {
                        const double angle = pi * (v - 0.5);
                        const double half_chord = std::cos(angle);
                        const Vec2d p(half_chord * (2 * u - 1), std::sin(angle));
                        const double azimuth = std::atan2(p.y, p.x) / (2 * pi);
                        const Vec2d uv(glm::length(p), azimuth < 0 ? azimuth + 1 : azimuth);
                        return LightPoint{center + p.x * axis_x + p.y * axis_y, normal,
                                          2 * pi * half_chord * half_chord * area,
                                          shape.radiance->evaluate(Vec2f(uv))};
                      },
                      2 * glm::length(axis_x), 2 * glm::length(axis_y)};
  }

  /// u along the axis, v around it: outside, the range of angles that faces x.
  Patch operator()(const transport::CylinderShape& shape) const {
    const Vec3d base(shape.base);
    const Vec3d axis(shape.axis);
    const Vec3d axis_x(shape.axis_x);
    const Vec3d axis_y(shape.axis_y);
    const Vec3d across = (x - base) - axis * glm::dot(x - base, axis);
    const double distance = glm::length(across);
    const double radius = shape.radius;
    double half_angle = pi;
    if (!shape.inwards) {
      if (!(distance > radius)) return std::nullopt;
      half_angle = std::acos(radius / distance);
    }
    const double middle = std::atan2(glm::dot(across, axis_y), glm::dot(across, axis_x));
    const double length = shape.length;
    return LightPatch{[=](double u, double v) {
                        const double angle = middle + half_angle * (2 * v - 1);
                        const Vec3d outward = std::cos(angle) * axis_x + std::sin(angle) * axis_y;
                        const double turns = angle / (2 * pi);
                        const Vec2d uv(turns - std::floor(turns), u);
                        return LightPoint{
                            base + u * length * axis + radius * outward, shape.inwards ? -outward : outward,
                            2 * half_angle * radius * length, shape.radiance->evaluate(Vec2f(uv))};
                      },
                      length, 2 * radius * half_angle};
  }

  template <typename Other>
  Patch operator()(const Other&) const {
    return std::nullopt;
  }
};

}  // namespace

Vec3d light_normal(const transport::LightShape& shape, const Vec3d& y) {
  return std::visit(NormalAt{y}, shape);
}

std::optional<LightPatch> light_patch(const transport::LightShape& shape, const Vec3d& x) {
  return std::visit(PatchFor{x}, shape);
}

}  // namespace fogbank::derivatives
