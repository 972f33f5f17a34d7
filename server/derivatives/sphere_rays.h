// What a point sees in all directions: the lines of sight of a direction grid, continued by smooth mirrors.
#pragma once

#include <memory>
#include <span>
#include <vector>

#include "derivatives/direction_grid.h"
#include "derivatives/sightlines.h"
#include "derivatives/surface_radiance.h"
#include "transport/plan.h"

namespace fogbank::derivatives {

/// Where a line of sight ends. Behind a smooth mirror it ends at the virtual image: the distance is the sum
/// of all pieces, the normal is mirrored back (method.md section 7; exact for flat mirrors).
struct RayEnd {
  float distance = infinity;  ///< infinity: nothing there but the environment
  Vec3f normal{0};            ///< geometric, unit; 0 at infinity
  /// Equal for ends on one side of one surface; different ones need not be joined.
  uint32_t surface = nothing;
  bool is_mirrored = false;
  Spectrum weight{1};   ///< transmittance to the first surface
  Spectrum emitted{0};  ///< by an environment that is counted here and in no grid of its own

  static constexpr uint32_t nothing = 0xffffffff;
};

/// RayEnd::surface of the side of a surface that faces one of the six directions of the axes.
uint32_t surface_number(const scene::Hit& hit, const Vec3f& normal);

/// One trace of a grid of directions. For one thread; reusable.
class SphereRays {
 public:
  /// `world` and `plan` must outlive this.
  SphereRays(const transport::World& world, const transport::Plan& plan) : plan_(plan), lines_(world) {}

  /// Lines from `x` in `medium` in `n` x `n` stratified directions.
  void trace(const Vec3f& x, int32_t medium, int32_t n, RandomStream& random, RayCounters& counters);

  /// Environments are counted elsewhere.
  void forget_emitted() {
    for (RayEnd& end : ends_) end.emitted = Spectrum(0);
  }

  const DirectionTopology& topology() const { return *topology_; }
  const Sightlines& lines() const { return lines_; }
  /// One for each direction.
  std::span<const RayEnd> ends() const { return ends_; }
  /// The surfaces that may send light along rays, and the ray of each; empty if the plan wants none of it.
  std::span<const SurfaceHit> hits() const { return hits_; }
  std::span<const uint32_t> rays_of_hits() const { return rays_of_hits_; }

 private:
  bool is_mirror(uint32_t shape) const;
  void follow_mirrors(size_t ray, scene::SurfaceInteraction surface, RandomStream& random,
                      RayCounters& counters);

  const transport::Plan& plan_;
  std::shared_ptr<const DirectionTopology> topology_;
  Sightlines lines_;
  std::vector<RayEnd> ends_;
  std::vector<SurfaceHit> hits_;
  std::vector<uint32_t> rays_of_hits_;
};

}  // namespace fogbank::derivatives
