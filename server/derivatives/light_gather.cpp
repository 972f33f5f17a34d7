#include "derivatives/light_gather.h"

#include <algorithm>
#include <cmath>

#include "derivatives/grid_assembly.h"

namespace fogbank::derivatives {

namespace {

/// Where infinity is, in radii of the scene (method.md section 7).
constexpr double far_radii = 1e4;
/// Least distance to a light, in radii of the scene: below it single precision no longer tells points apart.
constexpr double least_radii = 1e-7;

bool is_finite(const Jet3d& jet) {
  bool finite = std::isfinite(jet.value);
  for (int i = 0; i < 3; ++i) finite = finite && std::isfinite(jet.gradient[i]);
  for (const double entry : jet.hessian.entries) finite = finite && std::isfinite(entry);
  return finite;
}

}  // namespace

int32_t light_cells(int32_t samples) {
  return std::max(2, static_cast<int32_t>(std::lround(std::sqrt(static_cast<double>(samples)) / 4)));
}

LightGather::LightGather(const transport::World& world, const EstimatorSettings& settings)
    : world_(world),
      settings_(settings),
      cells_(light_cells(settings.samples)),
      far_distance_(far_radii * std::max(world.scene().bounds.radius, std::numeric_limits<float>::min())),
      lights_(gridded_lights(world, least_radii * world.scene().bounds.radius)) {}

void LightGather::add(const Vec3f& x, int32_t medium, RandomStream& random, RadianceJet& sum,
                      RayCounters& counters) const {
  LightGrid grid;
  for (const GriddedLightPointer& light : lights_) {
    light->cut(Vec3d(x), cells_, random, grid);
    if (!grid.triangles.empty()) add_grid(grid, x, medium, sum, counters);
  }
}

void LightGather::add_grid(const LightGrid& grid, const Vec3f& x, int32_t medium, RadianceJet& sum,
                           RayCounters& counters) const {
  const LightRays rays(world_, x, medium, counters);
  std::vector<MediaPath> paths(grid.vertices.size());
  rays.trace(grid.vertices, grid.at_infinity, paths);
  std::vector<uint8_t> visible(paths.size());
  std::transform(paths.begin(), paths.end(), visible.begin(),
                 [](const MediaPath& path) { return path.blocked() ? uint8_t{0} : uint8_t{1}; });
  const auto seen_vertices = std::count(visible.begin(), visible.end(), 1);
  if (seen_vertices == 0) return;

  const SeenGrid seen{grid, paths, visible};
  const bool with_blockers = settings_.derivatives != DerivativeOrder::value;
  RadianceJet light;
  if (settings_.bisect || static_cast<size_t>(seen_vertices) == visible.size()) {
    add_cut_grid(seen, find_silhouettes(grid, visible, rays, with_blockers), settings_, light);
  } else {
    std::vector<double> blockers(visible.size(), infinity);
    if (with_blockers) {
      for (const LightGrid::Triangle& triangle : grid.triangles) {
        for (size_t i = 0; i < 3; ++i) {
          const uint32_t blocked = triangle.vertices[i];
          const bool beside_visible =
              visible[triangle.vertices[(i + 1) % 3]] != 0 || visible[triangle.vertices[(i + 2) % 3]] != 0;
          if (visible[blocked] == 0 && beside_visible && !std::isfinite(blockers[blocked]))
            blockers[blocked] = rays.blocker_distance(grid.vertices[blocked], grid.at_infinity);
        }
      }
    }
    add_plain_grid(seen, blockers, far_distance_, settings_, light);
  }
  for (size_t c = 0; c < 3; ++c) {
    // What lies beyond the range of doubles (a point on a light's edge) has no derivative to speak of.
    if (is_finite(light.channels[c])) sum.channels[c] += light.channels[c];
  }
}

}  // namespace fogbank::derivatives
