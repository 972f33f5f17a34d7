#include <numbers>

#include "core/frame.h"
#include "derivatives/light_grids/kinds.h"
#include "derivatives/light_grids/patch.h"
#include "derivatives/light_grids/refinement.h"

namespace fogbank::derivatives {

namespace {

class GriddedSphere final : public GriddedLight {
 public:
  GriddedSphere(const transport::SphereShape& shape, int32_t n, double least_distance)
      : shape_(shape), n_(n), radius_(shape.radius), least_distance_(least_distance) {
    if (shape.inwards) directions_ = uniform_directions(8 * static_cast<size_t>(n) * static_cast<size_t>(n));
  }

  void cut(const Vec3d& x, RandomStream& random, LightGrid& grid) const override {
    grid.clear();
    const Vec3d center = Vec3d(shape_.center) - x;
    const double distance = glm::length(center);
    if ((distance < radius_) != shape_.inwards) return;
    if (shape_.inwards) {
      cut_inside(center, random, grid);
    } else {
      cut_cap(center, std::max(distance, radius_ + least_distance_), random, grid);
    }
  }

 private:
  /// The visible cap; directions are uniform in solid angle.
  void cut_cap(Vec3d center, double distance, RandomStream& random, LightGrid& grid) const {
    const Vec3d axis = glm::normalize(center);
    center = axis * distance;
    const Vec3d tangent = Vec3d(Frame::from_normal(Vec3f(axis)).tangent);
    const Vec3d axis_x = glm::normalize(tangent - axis * glm::dot(tangent, axis));
    const Vec3d axis_y = glm::cross(axis, axis_x);
    const double sine = radius_ / distance;
    const double cosine = std::sqrt((1 - sine) * (1 + sine));
    const double cap = sine * sine / (1 + cosine);  // 1 - cos of the half angle, without cancellation
    // The regular spherical polygon through the border points has the cap's solid angle.
    const double half_step = std::numbers::pi / (4 * n_);
    const double border = std::sin(cap * half_step) / (std::sin(half_step) * std::cos(half_step * cosine));
    const auto direction = [&](const Vec2d& p, double one_minus_cos) {
      const double across = std::sqrt(one_minus_cos * (2 - one_minus_cos));
      const double length = glm::length(p);
      const Vec2d around = length > 0 ? p / length : Vec2d(1, 0);
      return axis * (1 - one_minus_cos) + (axis_x * around.x + axis_y * around.y) * across;
    };
    const std::vector<Vec2d> points = patch_points(n_, n_, false, random);
    grid.round = LightGrid::RoundSurface{center, Vec3d(0), radius_, false};
    const double tangent_distance = distance * cosine;
    for (const Vec2d& point : points) {
      const Vec2d p = square_to_disk(point);
      const bool on_border = point.x == 0 || point.x == 1 || point.y == 0 || point.y == 1;
      grid.vertices.push_back(on_border ? direction(p, border) * tangent_distance
                                        : grid.round->in_direction(direction(p, cap * glm::dot(p, p))));
    }
    append_patch_triangles(n_, n_, 0, false, grid);
    set_radiance(
        *shape_.radiance, points,
        [&](const Vec2d& point) {
          const Vec2d p = square_to_disk(point);
          return uv_of(grid.round->in_direction(direction(p, cap * glm::dot(p, p))) - center);
        },
        grid);
    if (!(tangent_distance > 0)) return;
    const double bend =
        4 * half_step / 2 * sine * radius_ / (tangent_distance * tangent_distance * tangent_distance);
    const auto add_round_edge = [&](uint32_t a, uint32_t b, size_t triangle) {
      const Vec3d middle = glm::normalize(grid.vertices[a] + grid.vertices[b]);
      const Vec3d around = glm::normalize(middle - axis * glm::dot(middle, axis));
      grid.round_edges.push_back(
          {{a, b}, grid.triangles[triangle].radiance, around * cosine - axis * sine, bend});
    };
    // Cell (column, row) has triangles 2 (row n_ + column) and the next; either will do for its radiance.
    const auto side = static_cast<uint32_t>(n_);
    const uint32_t stride = side + 1;
    for (uint32_t i = 0; i < side; ++i) {
      add_round_edge(i, i + 1, 2 * i);
      add_round_edge(side * stride + i, side * stride + i + 1, 2 * ((side - 1) * side + i));
      add_round_edge(i * stride, (i + 1) * stride, 2 * (i * side));
      add_round_edge(i * stride + side, (i + 1) * stride + side, 2 * (i * side + side - 1));
    }
  }

  /// All of an inward emitter around x.
  void cut_inside(const Vec3d& center, RandomStream& random, LightGrid& grid) const {
    grid.round = LightGrid::RoundSurface{center, Vec3d(0), radius_, true};
    const glm::dmat3 rotation = random_rotation(random);
    for (const Vec3d& direction : directions_.directions)
      grid.vertices.push_back(grid.round->in_direction(glm::normalize(rotation * direction)));
    for (const auto& triangle : directions_.triangles) {
      const auto& [a, b, c] = triangle;
      grid.triangles.push_back(
          {triangle, shape_.radiance->is_constant()
                         ? shape_.radiance->evaluate(Vec2f(0))
                         : mean_over_triangle(
                               grid.vertices[a], grid.vertices[b], grid.vertices[c], [&](const Vec3d& p) {
                                 return shape_.radiance->evaluate(
                                     uv_of(grid.round->in_direction(glm::normalize(p)) - center));
                               })});
    }
  }

  Vec2f uv_of(const Vec3d& normal) const {
    const Vec3d local = glm::normalize(Vec3d(shape_.to_local * Vec3f(glm::normalize(normal))));
    const double turn = std::atan2(local.y, local.x) / (2 * std::numbers::pi);
    return Vec2f(
        Vec2d(turn < 0 ? turn + 1 : turn, std::acos(std::clamp(local.z, -1.0, 1.0)) / std::numbers::pi));
  }

  transport::SphereShape shape_;
  int32_t n_;
  double radius_;
  double least_distance_;
  DirectionMesh directions_;  ///< of inward emitters
};

}  // namespace

GriddedLightPointer grid_sphere(const transport::SphereShape& shape, int32_t n, double least_distance) {
  return std::make_unique<GriddedSphere>(shape, n, least_distance);
}

}  // namespace fogbank::derivatives
