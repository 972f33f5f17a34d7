// Direct light of sources without extent: point, spot and directional lights.
#pragma once

#include <vector>

#include "derivatives/radiance_jet.h"
#include "transport/plan.h"
#include "transport/world.h"

namespace fogbank::derivatives {

/// Closed forms with one shadow ray a light (method.md section 7). Their shadows' edges are jumps, which no
/// derivative can show: a light that is blocked at x counts as absent. Immutable.
class DeltaLights {
 public:
  /// `world` must outlive this. Points closer to a light than `least_distance` count as that far away.
  DeltaLights(const transport::World& world, const transport::Plan& plan, double least_distance);

  size_t size() const { return points_.size() + directional_.size(); }
  /// Adds mean incoming radiance at `x` inside `medium` (scene::none: vacuum).
  void add(const Vec3f& x, int32_t medium, RadianceJet& sum, RayCounters& counters) const;

 private:
  const transport::World& world_;
  std::vector<transport::PointShape> points_;
  std::vector<transport::DirectionalShape> directional_;
  double least_distance_;
};

}  // namespace fogbank::derivatives
