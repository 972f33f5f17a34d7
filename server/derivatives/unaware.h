// Occlusion-unaware derivatives: the rival, after Jarosz, Donner, Zwicker and Jensen 2008, "Radiance Caching
// for Participating Media".
//
// Every sample of light is a fixed point y, on a light, on a surface, or in the medium, and the transport
// kernel from y to x is differentiated with visibility held constant (method.md section 9). In the open this
// is exact up to noise; where silhouettes move over a light it misses their motion, which in a penumbra is
// nearly all of the derivative.
#pragma once

#include <memory>

#include "derivatives/estimator.h"
#include "derivatives/sightlines.h"
#include "transport/path_tracer.h"
#include "transport/plan.h"

namespace fogbank::derivatives {

/// An estimate with what the rival's first-order radius follows from.
struct UnawareEstimate {
  RadianceJet mean;
  /// Sum of the magnitudes of the single samples' gradients of luminance: at least |gradient| of the mean's.
  double gradient_magnitude = 0;
};

class Unaware final : public Estimator {
 public:
  /// Each light gets settings.samples / 5 shadow rays (about the rays of the other method's light grid and
  /// its bisections) by its share of the fluence, surfaces settings.samples directions, the medium
  /// four points along each of those.
  Unaware(std::shared_ptr<const transport::World> world, const EstimatorSettings& settings);

  RadianceJet estimate(const Vec3f& x, uint32_t repeat, RayCounters& counters) const override {
    return estimate_changes(x, repeat, counters).mean;
  }
  /// `estimate`; the magnitude is 0 where settings.derivatives is `value`.
  UnawareEstimate estimate_changes(const Vec3f& x, uint32_t repeat, RayCounters& counters) const;

 private:
  struct Gather;

  void add_lights(Gather& gather) const;
  void add_sphere(Gather& gather) const;
  /// Light from the medium along one line, weighted by `share` (1 / number of lines).
  void march(Gather& gather, const Sightlines& lines, size_t line, float share) const;

  std::shared_ptr<const transport::World> world_;
  EstimatorSettings settings_;
  transport::Plan plan_;
  transport::PathTracer paths_;
  int32_t emitters_ = 0;  ///< a mesh or an environment counts as one
};

}  // namespace fogbank::derivatives
