// Where gathers take the light from that medium and surfaces send out: path traced, given by a function
// (tests), or looked up in a cache.
#pragma once

#include <span>

#include "core/random.h"
#include "core/ray_counters.h"
#include "scene/scene.h"
#include "transport/direct_light.h"

namespace fogbank::derivatives {

/// q(y) of method.md sections 1 and 8: what the medium sends out, per unit of sigma_s.
class MediumSource {
 public:
  virtual ~MediumSource() = default;
  /// Mean radiance (fluence / 4 pi): what is sent out on average over directions, and in all of them where
  /// the phase function is isotropic. One unbiased sample at `y` inside `medium`; finite, >= 0. Draws only
  /// from `random`.
  virtual Spectrum mean_radiance(const Vec3f& y, int32_t medium, RandomStream& random,
                                 RayCounters& counters) const = 0;
  /// The same with what is sent out against a ray that passes `y` in `direction`, unit.
  virtual transport::MediumLight light(const Vec3f& y, const Vec3f& /*direction*/, int32_t medium,
                                       RandomStream& random, RayCounters& counters) const {
    const Spectrum mean = mean_radiance(y, medium, random, counters);
    return {mean, mean};
  }
  /// Samples are free of noise, so that no filtering is due.
  virtual bool exact() const { return false; }
};

/// Light that a medium sends along lines.
class LineSource {
 public:
  virtual ~LineSource() = default;
  /// Radiance that `medium` scatters against `ray` between its origin and `length` (may be infinite), with
  /// the transmittance up to there. One unbiased sample; finite, >= 0. Draws only from `random`.
  virtual Spectrum in_scattered(const Ray& ray, float length, int32_t medium, RandomStream& random,
                                RayCounters& counters) const = 0;
};

/// What a ray ended at.
struct SurfaceHit {
  scene::SurfaceInteraction surface;
  Vec3f direction{0, 0, 1};      ///< of the ray, unit: towards the surface
  int32_t medium = scene::none;  ///< where the ray arrives
  /// How much the hit's radiance counts, >= 0: its transmittance to the ray's origin. 0: not at all.
  float importance = 1;
};

/// Radiance that surfaces send against rays because they scatter light: reflected and refracted, without
/// their own emission and without what comes straight on through them.
class SurfaceSource {
 public:
  virtual ~SurfaceSource() = default;
  /// Mean of `samples` (>= 1) unbiased samples; finite, >= 0. Draws only from `random`.
  virtual Spectrum leaving_radiance(const SurfaceHit& hit, int32_t samples, RandomStream& random,
                                    RayCounters& counters) const = 0;
};

/// The light around a point. What is referred to must outlive this.
struct LightSources {
  const MediumSource& medium;
  const SurfaceSource& surfaces;
};

}  // namespace fogbank::derivatives
