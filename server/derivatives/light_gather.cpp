#include "derivatives/light_gather.h"

#include <algorithm>
#include <cmath>

#include "derivatives/grid_assembly.h"
#include "derivatives/light_triangles.h"

namespace fogbank::derivatives {

namespace {

/// Where infinity is, in radii of the scene (method.md section 7).
constexpr double far_radii = 1e4;
/// Least distance to a light, in radii of the scene: against lengths of 0 alone. The closed forms hold down
/// to it, and a light that is moved away further ends up behind itself as shadow rays see it.
constexpr double least_radii = 1e-12;

/// What lies beyond the range of doubles (a point on a light's very edge) has no derivative to speak of.
void add_finite(const Jet3d& jet, Jet3d& sum) {
  bool finite = true;
  for (int i = 0; i < 3; ++i) finite = finite && std::isfinite(jet.gradient[i]);
  for (const double entry : jet.hessian.entries) finite = finite && std::isfinite(entry);
  if (std::isfinite(jet.value)) sum += finite ? jet : Jet3d::constant(jet.value);
}

}  // namespace

int32_t light_cells(int32_t samples) {
  return std::max(2, static_cast<int32_t>(std::lround(std::sqrt(static_cast<double>(samples)) / 4)));
}

LightGather::LightGather(const transport::World& world, const transport::Plan& plan,
                         const EstimatorSettings& settings)
    : world_(world),
      plan_(plan),
      settings_(settings),
      far_distance_(far_radii * std::max(world.scene().bounds.radius, std::numeric_limits<float>::min())),
      lights_(planned_lights(world, plan, light_cells(settings.samples),
                             least_radii * world.scene().bounds.radius)),
      delta_lights_(world, plan, least_radii * world.scene().bounds.radius) {}

void LightGather::add(const Vec3f& x, int32_t medium, RandomStream& random, RadianceJet& sum,
                      RayCounters& counters) const {
  RadianceJet light;
  delta_lights_.add(x, medium, light, counters);
  LightGrid grid;
  for (const PlannedLight& planned : lights_) {
    counters.poll();
    planned.gridded->cut(Vec3d(x), random, grid);
    if (grid.triangles.empty()) continue;
    const bool open = std::none_of(planned.lights.begin(), planned.lights.end(), [&](uint32_t index) {
      return plan_.may_be_occluded(index, x) || plan_.may_cross_boundaries(index, x);
    });
    const SeenGrid seen(world_, x, medium, open, grid, counters);
    add_unoccluded(grid, seen.sigma_t(), settings_.derivatives, counters, light);
    if (seen.visible_count() == 0) continue;
    if (settings_.bisect || seen.visible_count() == grid.vertices.size()) {
      const bool with_blockers = settings_.derivatives != DerivativeOrder::value;
      add_cut_grid(seen, find_silhouettes(seen, with_blockers), settings_, light);
    } else {
      add_plain_grid(seen, far_distance_, settings_, light);
    }
  }
  for (size_t c = 0; c < 3; ++c) add_finite(light.channels[c], sum.channels[c]);
}

}  // namespace fogbank::derivatives
