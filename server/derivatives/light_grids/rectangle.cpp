#include "derivatives/light_grids/kinds.h"
#include "derivatives/light_grids/patch.h"

namespace fogbank::derivatives {

namespace {

class GriddedRectangle final : public GriddedLight {
 public:
  GriddedRectangle(const transport::RectangleShape& shape, int32_t n, double least_distance)
      : shape_(shape),
        n_(n),
        normal_(glm::normalize(glm::cross(Vec3d(shape.edge_x), Vec3d(shape.edge_y)))),
        least_distance_(least_distance) {}

  void cut(const Vec3d& x, RandomStream& random, LightGrid& grid) const override {
    grid.clear();
    Vec3d corner = Vec3d(shape_.corner) - x;
    const double height = -glm::dot(corner, normal_);
    if (!(height > 0)) return;
    if (height < least_distance_) corner -= normal_ * (least_distance_ - height);
    const std::vector<Vec2d> points = patch_points(n_, n_, true, random);
    for (const Vec2d& p : points)
      grid.vertices.push_back(corner + Vec3d(shape_.edge_x) * p.x + Vec3d(shape_.edge_y) * p.y);
    // The normal looks at x: counter-clockwise along it is clockwise as directions from x go.
    append_patch_triangles(n_, n_, 0, true, grid);
    const auto& uvs = shape_.uvs;
    set_radiance(
        *shape_.radiance, points,
        [&](const Vec2d& p) {
          return uvs[0] + (uvs[1] - uvs[0]) * static_cast<float>(p.x) +
                 (uvs[2] - uvs[0]) * static_cast<float>(p.y);
        },
        grid);
  }

 private:
  transport::RectangleShape shape_;
  int32_t n_;
  Vec3d normal_;
  double least_distance_;
};

}  // namespace

GriddedLightPointer grid_rectangle(const transport::RectangleShape& shape, int32_t n, double least_distance) {
  return std::make_unique<GriddedRectangle>(shape, n, least_distance);
}

}  // namespace fogbank::derivatives
