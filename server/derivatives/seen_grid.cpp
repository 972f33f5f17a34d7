#include "derivatives/seen_grid.h"

namespace fogbank::derivatives {

namespace {

void append(const LightGrid& grid, const std::vector<Vec3d>& points, Sightlines& lines,
            RayCounters& counters) {
  if (!grid.at_infinity) {
    lines.append_to_points(points, counters);
    return;
  }
  const std::vector<Vec3f> directions(points.begin(), points.end());
  constexpr std::array<float, 1> limit{infinity};
  lines.append(directions, limit, counters);
}

}  // namespace

SeenGrid::SeenGrid(const transport::World& world, const Vec3f& x, int32_t medium, bool open,
                   const LightGrid& grid, RayCounters& counters)
    : world_(world), grid_(grid), counters_(counters), lines_(world), open_(open) {
  if (medium != scene::none) sigma_t_ = world.medium(medium).sigma_t;
  lines_.start(x, medium);
  if (!open) append(grid, grid.vertices, lines_, counters);
  for (uint32_t i = 0; i < grid.vertices.size(); ++i) visible_count_ += visible(i) ? 1 : 0;
}

void SeenGrid::test(const std::vector<Vec3d>& points, std::vector<Spectrum>& transmittances) const {
  std::vector<Vec3d> targets = points;
  // Far beyond any surface; squares of it are still finite in single precision.
  constexpr double far = 1e18;
  if (grid_.at_infinity) {
    for (Vec3d& target : targets) target *= far;
  }
  transmittances.resize(targets.size());
  visibility(world_, lines_.origin(), lines_.medium(), targets, transmittances, counters_);
}

std::vector<double> SeenGrid::blocker_distances(const std::vector<Vec3d>& points) const {
  Sightlines lines(world_);
  lines.start(lines_.origin(), lines_.medium());
  append(grid_, points, lines, counters_);
  std::vector<double> distances(points.size());
  for (size_t i = 0; i < points.size(); ++i) distances[i] = lines.distance(i);
  return distances;
}

RadianceJet SeenGrid::transmittance(uint32_t vertex, const Vec3d& point) const {
  MediaPath path;
  path.sigma_t = sigma_t_;
  if (!open_) path = lines_.path(vertex);
  return grid_.at_infinity ? path.towards_infinity(point) : path.towards(point);
}

bool SeenGrid::in_one_medium(uint32_t vertex) const {
  return !is_black(sigma_t_) && (open_ || lines_.crossings(vertex).empty());
}

}  // namespace fogbank::derivatives
