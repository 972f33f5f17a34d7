// What a surface point sees: the lines of sight of a hemisphere grid.
#pragma once

#include <memory>
#include <vector>

#include "derivatives/hemisphere_grid.h"
#include "derivatives/sphere_rays.h"

namespace fogbank::derivatives {

/// A side of a surface whose irradiance is asked for.
struct SurfaceSide {
  scene::SurfaceInteraction surface;
  Vec3f normal{0, 0, 1};         ///< unit; the shading normal, turned to the side
  int32_t medium = scene::none;  ///< on that side
};

/// One trace of a hemisphere grid around the normal. For one thread.
class HemisphereRays {
 public:
  /// Draws the frame's turn and the places in cells from `random`. `grid` and `world` must outlive this.
  /// Throws Interrupted.
  HemisphereRays(const transport::World& world, const HemisphereGrid& grid, const SurfaceSide& side,
                 RandomStream& random, RayCounters& counters);

  const HemisphereGrid& grid() const { return grid_; }
  const SurfaceSide& side() const { return side_; }
  /// Of the cells. Lines below the surface itself, as there are where the shading normal differs from the
  /// geometric one, go nowhere.
  const Sightlines& lines() const { return lines_; }
  /// Does a cell's direction leave to the normal's side of the surface itself?
  bool leaves_outside(uint32_t cell) const { return glm::dot(directions_[cell], outward_) > 0; }
  /// One for each vertex of the grid, as of `ends`.
  const std::vector<Vec3f>& directions() const { return directions_; }
  /// At the horizon: where the surface that the cell next to it sees would go on to, as a plane. Directions
  /// that don't leave outside have an end at infinity.
  const std::vector<RayEnd>& ends() const { return ends_; }
  /// What cells see, and the cell of each.
  const std::vector<SurfaceHit>& hits() const { return hits_; }
  const std::vector<uint32_t>& cells_of_hits() const { return cells_of_hits_; }

 private:
  void add_hit(uint32_t cell, const scene::SurfaceInteraction& surface, int32_t medium);

  const HemisphereGrid& grid_;
  SurfaceSide side_;
  Vec3f outward_;  ///< geometric normal on the side
  Sightlines lines_;
  std::vector<Vec3f> directions_;
  std::vector<RayEnd> ends_;
  std::vector<SurfaceHit> hits_;
  std::vector<uint32_t> cells_of_hits_;
};

}  // namespace fogbank::derivatives
