#include "derivatives/light_grids/kinds.h"
#include "derivatives/light_grids/patch.h"

namespace fogbank::derivatives {

namespace {

class GriddedRectangle final : public GriddedLight {
 public:
  GriddedRectangle(const transport::RectangleShape& shape, double least_distance)
      : shape_(shape),
        normal_(glm::normalize(glm::cross(Vec3d(shape.edge_x), Vec3d(shape.edge_y)))),
        least_distance_(least_distance) {}

  void cut(const Vec3d& x, int32_t n, RandomStream& random, LightGrid& grid) const override {
    grid.clear();
    Vec3d corner = Vec3d(shape_.corner) - x;
    const double height = -glm::dot(corner, normal_);
    if (!(height > 0)) return;
    if (height < least_distance_) corner -= normal_ * (least_distance_ - height);
    const std::vector<Vec2d> points = patch_points(n, n, true, random);
    for (const Vec2d& p : points)
      grid.vertices.push_back(corner + Vec3d(shape_.edge_x) * p.x + Vec3d(shape_.edge_y) * p.y);
    // The normal looks at x: counter-clockwise along it is clockwise as directions from x go.
    append_patch_triangles(n, n, 0, true, grid);
    std::vector<Vec2f> uvs;
    for (const Vec2d& p : points)
      uvs.push_back(shape_.uvs[0] + (shape_.uvs[1] - shape_.uvs[0]) * static_cast<float>(p.x) +
                    (shape_.uvs[2] - shape_.uvs[0]) * static_cast<float>(p.y));
    set_radiance(*shape_.radiance, uvs, grid);
  }

 private:
  transport::RectangleShape shape_;
  Vec3d normal_;
  double least_distance_;
};

}  // namespace

GriddedLightPointer grid_rectangle(const transport::RectangleShape& shape, double least_distance) {
  return std::make_unique<GriddedRectangle>(shape, least_distance);
}

}  // namespace fogbank::derivatives
