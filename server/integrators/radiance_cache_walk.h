// A camera path of the radiance cache; for the files of RadianceCacheIntegrator alone.
#pragma once

#include "integrators/radiance_cache.h"

namespace fogbank::integrators {

/// A camera path: straight through clear surfaces, mirrors and glass, and by one random direction a surface
/// where irradiance isn't enough.
struct RadianceCacheIntegrator::Walk {
  Ray ray;
  Spectrum throughput{1};
  int32_t medium = scene::none;
  int32_t depth = 0;   ///< scattering events so far
  float last_pdf = 0;  ///< of the direction; 0: emission counts in full
  bool sees_emission = true;
  bool ended = false;
  int32_t null_events = 0;  ///< surfaces passed straight on
  Vec3f last_position{0};
  transport::LightReceiver last_receiver;
  int32_t last_light_samples = 1;  ///< that were taken there
  LookUpObserver* observer = nullptr;
  bool wants_cached = true;  ///< PixelSample::cached
  bool straight = true;      ///< no random direction so far but of mirrors and glass
};

}  // namespace fogbank::integrators
