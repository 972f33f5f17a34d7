// Where the march of multiple scattering takes the medium's own light from.
#pragma once

#include "core/random.h"
#include "core/ray_counters.h"
#include "core/vector.h"

namespace fogbank::derivatives {

/// q(y) of method.md sections 1 and 8: mean radiance (fluence / 4 pi) at points of the medium; times sigma_s
/// it is what the medium sends out. Path traced, given by a function (tests), or looked up in a cache.
class MediumSource {
 public:
  virtual ~MediumSource() = default;
  /// One unbiased sample at `y` inside `medium`; finite, >= 0. Draws only from `random`.
  virtual Spectrum mean_radiance(const Vec3f& y, int32_t medium, RandomStream& random,
                                 RayCounters& counters) const = 0;
  /// Samples are free of noise, so that no filtering is due.
  virtual bool exact() const { return false; }
};

}  // namespace fogbank::derivatives
