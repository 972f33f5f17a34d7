// Participating media.
#pragma once

#include "core/vector.h"
#include "scene/description.h"

namespace fogbank::scene {

/// Homogeneous medium. `sigma_t` is per scene unit with the file's `scale` applied; albedo = sigma_s /
/// sigma_t in [0, 1].
/// Of phase functions, absolute: up to it radiance records hold what a medium scatters (why no more:
/// cache/directional_shape.h).
inline constexpr float most_recorded_mean_cosine = 0.6f;

struct Medium {
  std::string id;
  Spectrum sigma_t{0};
  Spectrum albedo{0};
  ObjectPointer phase;  ///< null means isotropic; `transport` builds the phase function

  Spectrum sigma_s() const { return sigma_t * albedo; }
};

}  // namespace fogbank::scene
