// Next-event estimation by several well-spread samples at once, for what a pixel sees directly: points of a
// Sobol' sequence that goes on over the pixel's samples, shadow rays in packets.
#pragma once

#include "core/random.h"
#include "transport/bundle_points.h"
#include "transport/direct_light.h"

namespace fogbank::transport {

/// As in_scattered_radiance() of direct_light.h where nothing else finds the emission, of the lights of
/// `subset`; `samples`: a power of two up to most_bundle_samples, the same for all samples of a pixel.
Spectrum in_scattered_radiance_bundle(const World& world, const MediumSegment& segment, int32_t medium,
                                      LightSubset subset, int32_t samples, RandomStream& random,
                                      RayCounters& counters);

/// As reflected_direct_light() of direct_light.h; `samples` as above, of the lights besides parallel ones,
/// which have one more each. Where paths find emission too its weights are those of `samples` times the
/// density of one sample of LightSubset::besides_parallel.
Spectrum reflected_direct_light_bundle(const World& world, const scene::SurfaceInteraction& surface,
                                       const Vec3f& ray_direction, int32_t medium, int32_t samples,
                                       EmissionFoundBy found_by, RandomStream& random, RayCounters& counters);

}  // namespace fogbank::transport
