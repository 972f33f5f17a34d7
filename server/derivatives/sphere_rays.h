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
  uint32_t hit = nothing;  ///< which of SphereRays::hits() sends light along the ray
  uint8_t mirrors = 0;     ///< between the point and the end
  Spectrum weight{1};      ///< transmittance times reflectance of the mirrors
  Spectrum emitted{0};     ///< counted here and in no light's own grid

  static constexpr uint32_t nothing = 0xffffffff;
};

/// Do the ends of two neighbouring lines lie on surfaces that meet between them, or is there a jump in depth?
bool surfaces_meet(const Vec3f& direction_a, const RayEnd& a, const Vec3f& direction_b, const RayEnd& b);

/// One trace of a grid of directions. For one thread; reusable.
class SphereRays {
 public:
  /// `world` and `plan` must outlive this.
  SphereRays(const transport::World& world, const transport::Plan& plan) : plan_(plan), lines_(world) {}

  /// Lines from `x` in `medium` in `n` x `n` stratified directions. `max_depth`: edges of a whole path.
  void trace(const Vec3f& x, int32_t medium, int32_t n, int32_t max_depth, RandomStream& random,
             RayCounters& counters);

  const DirectionTopology& topology() const { return *topology_; }
  const Sightlines& lines() const { return lines_; }
  /// One for each direction.
  std::span<const RayEnd> ends() const { return ends_; }
  /// Surfaces that may send light along rays, by number of mirrors before them.
  std::span<const SurfaceHit> hits() const { return hits_; }
  /// How many of hits() lie behind at most `mirrors` mirrors; the last entry is all of them.
  std::span<const size_t> hits_up_to() const { return hits_up_to_; }

  /// The end of a line that was not traced with the grid, mirrors not followed: for bisection.
  static RayEnd end_of(const Sightlines& lines, size_t line);

 private:
  /// A line on its way from mirror to mirror.
  struct Mirrored {
    size_t ray = 0;
    scene::SurfaceInteraction surface;  ///< the mirror that was met
    Vec3f direction{0, 0, 1};           ///< in which it was met
    int32_t medium = scene::none;
    std::vector<Vec3f> normals;  ///< of the mirrors before it
  };

  bool is_mirror(uint32_t shape) const;
  void add_hit(size_t ray, const scene::SurfaceInteraction& surface, const Vec3f& direction, int32_t medium);
  void follow(Mirrored& path, std::vector<Mirrored>& further, RandomStream& random, RayCounters& counters);
  Spectrum environment(const Vec3f& direction, bool mirrored) const;

  const transport::Plan& plan_;
  std::shared_ptr<const DirectionTopology> topology_;
  Sightlines lines_;
  std::vector<RayEnd> ends_;
  std::vector<SurfaceHit> hits_;
  std::vector<size_t> hits_up_to_;
};

}  // namespace fogbank::derivatives
