#include <numbers>

#include "derivatives/light_grids/kinds.h"
#include "derivatives/light_grids/patch.h"

namespace fogbank::derivatives {

namespace {

class GriddedDisk final : public GriddedLight {
 public:
  GriddedDisk(const transport::DiskShape& shape, int32_t n, double least_distance)
      : shape_(shape),
        n_(n),
        normal_(shape.normal),
        mirrored_(glm::dot(glm::cross(shape.axis_x, shape.axis_y), shape.normal) > 0),
        least_distance_(least_distance) {}

  void cut(const Vec3d& x, RandomStream& random, LightGrid& grid) const override {
    grid.clear();
    Vec3d center = Vec3d(shape_.center) - x;
    const double height = -glm::dot(center, normal_);
    if (!(height > 0)) return;
    if (height < least_distance_) center -= normal_ * (least_distance_ - height);
    const std::vector<Vec2d> points = patch_points(n_, n_, false, random);
    const double border = disk_border_radius(n_);
    for (const Vec2d& point : points) {
      const bool on_border = point.x == 0 || point.x == 1 || point.y == 0 || point.y == 1;
      const Vec2d p = square_to_disk(point) * (on_border ? border : 1.0);
      grid.vertices.push_back(center + Vec3d(shape_.axis_x) * p.x + Vec3d(shape_.axis_y) * p.y);
    }
    append_patch_triangles(n_, n_, 0, mirrored_, grid);
    set_radiance(
        *shape_.radiance, points,
        [](const Vec2d& point) {
          const Vec2d p = square_to_disk(point);
          const double turn = std::atan2(p.y, p.x) / (2 * std::numbers::pi);
          return Vec2f(Vec2d(glm::length(p), turn < 0 ? turn + 1 : turn));
        },
        grid);
  }

 private:
  transport::DiskShape shape_;
  int32_t n_;
  Vec3d normal_;
  bool mirrored_;
  double least_distance_;
};

}  // namespace

GriddedLightPointer grid_disk(const transport::DiskShape& shape, int32_t n, double least_distance) {
  return std::make_unique<GriddedDisk>(shape, n, least_distance);
}

}  // namespace fogbank::derivatives
