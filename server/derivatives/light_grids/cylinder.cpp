#include <numbers>

#include "derivatives/light_grids/kinds.h"
#include "derivatives/light_grids/patch.h"

namespace fogbank::derivatives {

namespace {

class GriddedCylinder final : public GriddedLight {
 public:
  GriddedCylinder(const transport::CylinderShape& shape, int32_t n, double least_distance)
      : shape_(shape),
        n_(n),
        base_(shape.base),
        axis_(shape.axis),
        axis_x_(shape.axis_x),
        axis_y_(shape.axis_y),
        radius_(shape.radius),
        // Counter-clockwise in (azimuth, height) is so seen from outside if the frame is right-handed.
        mirrored_((glm::dot(glm::cross(axis_x_, axis_y_), axis_) > 0) != shape.inwards),
        least_distance_(least_distance) {}

  void cut(const Vec3d& x, RandomStream& random, LightGrid& grid) const override {
    grid.clear();
    const Vec3d from_base = x - base_;
    const Vec2d across(glm::dot(from_base, axis_x_), glm::dot(from_base, axis_y_));
    double distance = glm::length(across);
    double middle = std::atan2(across.y, across.x);
    double half = std::numbers::pi;
    Vec3d base = -from_base;
    const bool outside = distance > radius_;
    if (outside != shape_.inwards && std::fabs(distance - radius_) < least_distance_) {
      const Vec3d outwards = axis_x_ * std::cos(middle) + axis_y_ * std::sin(middle);
      const double moved = shape_.inwards ? radius_ - least_distance_ : radius_ + least_distance_;
      base -= outwards * (moved - distance);
      distance = moved;
    }
    if (outside) {
      // A normal n_ faces x where n_ . across > radius, for the inner side where it is less.
      half = std::acos(radius_ / distance);
      if (shape_.inwards) {
        middle += std::numbers::pi;
        half = std::numbers::pi - half;
      }
    } else if (!shape_.inwards) {
      return;
    }
    if (!(half > 0)) return;
    const int32_t columns = outside ? n_ : 2 * n_;
    const std::vector<Vec2d> points = patch_points(columns, n_, outside, random);
    const auto normal_at = [&](double share) {
      const double angle = middle + (2 * share - 1) * half;
      return axis_x_ * std::cos(angle) + axis_y_ * std::sin(angle);
    };
    const double length = shape_.length;
    for (const Vec2d& p : points)
      grid.vertices.push_back(base + axis_ * (length * p.y) + normal_at(p.x) * radius_);
    grid.round = LightGrid::RoundSurface{base, axis_, radius_, shape_.inwards};
    append_patch_triangles(columns, n_, 0, mirrored_, grid);
    set_radiance(
        *shape_.radiance, points,
        [&](const Vec2d& p) {
          const double turn = (middle + (2 * p.x - 1) * half) / (2 * std::numbers::pi);
          return Vec2f(Vec2d(turn - std::floor(turn), p.y));
        },
        grid);
    if (!outside || shape_.inwards) return;
    for (int32_t row = 0; row < n_; ++row) {
      add_round_edge(row * (columns + 1), columns + 1, normal_at(0), 2 * row * columns, grid);
      add_round_edge(row * (columns + 1) + columns, columns + 1, normal_at(1), 2 * (row + 1) * columns - 1,
                     grid);
    }
  }

 private:
  /// The piece of a generator from vertex `low` to the next row's; `triangle` lies on it.
  void add_round_edge(int32_t low, int32_t stride, const Vec3d& normal, int32_t triangle,
                      LightGrid& grid) const {
    const auto a = static_cast<uint32_t>(low);
    const auto b = static_cast<uint32_t>(low + stride);
    const Vec3d from = grid.vertices[a];
    const Vec3d to = grid.vertices[b];
    const Vec3d middle = (from + to) * 0.5;
    const double distance = glm::length(middle);
    const double sine = glm::length(glm::cross(middle, axis_)) / distance;
    const double arc = std::atan2(glm::length(glm::cross(from, to)), glm::dot(from, to));
    // Euler: the curvature in the plane of sight is that of the circle times sin^2 of the angle to the axis.
    grid.round_edges.push_back({{a, b},
                                grid.triangles[static_cast<size_t>(triangle)].radiance,
                                normal,
                                arc * radius_ / (sine * sine * distance * distance * distance)});
  }

  transport::CylinderShape shape_;
  int32_t n_;
  Vec3d base_;
  Vec3d axis_;
  Vec3d axis_x_;
  Vec3d axis_y_;
  double radius_;
  bool mirrored_;
  double least_distance_;
};

}  // namespace

GriddedLightPointer grid_cylinder(const transport::CylinderShape& shape, int32_t n, double least_distance) {
  return std::make_unique<GriddedCylinder>(shape, n, least_distance);
}

}  // namespace fogbank::derivatives
