// Shadow rays from one point to many targets on a light.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "derivatives/media_path.h"
#include "transport/world.h"

namespace fogbank::derivatives {

/// Rays from `x` inside `medium`. Targets are relative to x, or unit directions where `at_infinity`. A target
/// is visible unless something that passes no light at all lies before it; what passes some is a weight.
class LightRays {
 public:
  LightRays(const transport::World& world, const Vec3f& x, int32_t medium, RayCounters& counters)
      : world_(world), x_(x), medium_(medium), counters_(counters) {}

  /// What lies before each target; one entry a target.
  void trace(std::span<const Vec3d> targets, bool at_infinity, std::span<MediaPath> paths) const;
  /// 1 where a target is visible, else 0.
  void visible(std::span<const Vec3d> targets, bool at_infinity, std::span<uint8_t> visible) const;
  /// Distance to the first thing before the target that passes no light; infinity if there is none.
  double blocker_distance(const Vec3d& target, bool at_infinity) const;

 private:
  Ray shadow_ray(const Vec3d& target, bool at_infinity) const;
  MediaPath trace(const Ray& ray) const;
  bool first_opaque(Ray ray, float& distance) const;

  const transport::World& world_;
  Vec3f x_;
  int32_t medium_;
  RayCounters& counters_;
};

}  // namespace fogbank::derivatives
