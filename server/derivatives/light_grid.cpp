#include "derivatives/light_grid.h"

#include "derivatives/light_grids/kinds.h"

namespace fogbank::derivatives {

void LightGrid::clear() {
  vertices.clear();
  triangles.clear();
  round_edges.clear();
  round.reset();
  at_infinity = false;
}

Vec3d LightGrid::between(const Vec3d& a, const Vec3d& b, double share) const {
  const Vec3d chord = a + (b - a) * share;
  if (at_infinity) return glm::normalize(chord);
  return chord;
}

std::vector<GriddedLightPointer> gridded_lights(const transport::World& world, double least_distance) {
  std::vector<GriddedLightPointer> lights;
  for (uint32_t i = 0; i < world.lights().size(); ++i) {
    const transport::LightShape shape = world.lights().light(i).shape();
    if (const auto* rectangle = std::get_if<transport::RectangleShape>(&shape))
      lights.push_back(grid_rectangle(*rectangle, least_distance));
  }
  return lights;
}

}  // namespace fogbank::derivatives
