// A light's grid with the shadow rays to its vertices.
#pragma once

#include <vector>

#include "derivatives/light_grid.h"
#include "derivatives/radiance_jet.h"
#include "derivatives/sightlines.h"

namespace fogbank::derivatives {

/// What lies between x and the vertices of a grid. A vertex is visible unless something that passes no light
/// at all lies before it; what passes some of it is a weight.
class SeenGrid {
 public:
  /// Traces all vertices from `x` inside `medium`, unless `open`: nothing can lie between, boundaries of
  /// media included. `world` and `grid` must outlive this.
  SeenGrid(const transport::World& world, const Vec3f& x, int32_t medium, bool open, const LightGrid& grid,
           RayCounters& counters);

  const LightGrid& grid() const { return grid_; }
  /// Tells whether the result is wanted still.
  const RayCounters& counters() const { return counters_; }
  /// Extinction of the medium around x, 1/length.
  const Spectrum& sigma_t() const { return sigma_t_; }
  bool visible(uint32_t vertex) const { return open_ || !lines_.is_blocked(vertex); }
  size_t visible_count() const { return visible_count_; }
  /// Distance to what blocks a vertex that isn't visible.
  double blocker_distance(uint32_t vertex) const { return lines_.distance(vertex); }

  /// 1 where a point of the light is visible; one any-hit ray each.
  void test(const std::vector<Vec3d>& points, std::vector<Spectrum>& transmittances) const;
  /// Distances to what blocks points of the light; infinity where nothing does.
  std::vector<double> blocker_distances(const std::vector<Vec3d>& points) const;

  /// Transmittance to a point of the light that lies behind the same surfaces as `vertex`, which is visible.
  RadianceJet transmittance(uint32_t vertex, const Vec3d& point) const;
  /// One medium reaches from x to this vertex, and absorbs.
  bool in_one_medium(uint32_t vertex) const;

 private:
  const transport::World& world_;
  const LightGrid& grid_;
  RayCounters& counters_;
  Sightlines lines_;  ///< one for each vertex, none where `open_`
  bool open_;
  Spectrum sigma_t_{0};
  size_t visible_count_ = 0;
};

}  // namespace fogbank::derivatives
