// Single scattering of a directional light along a segment: shadow rays go where a shadow map doesn't know.
#pragma once

#include "core/random.h"
#include "transport/shadow_map.h"

namespace fogbank::transport {

/// Radiance of the directional light `light` scattered once in `segment` (through `medium`) against its
/// direction, with the transmittance up to its origin; unbiased, whatever `map` guesses: what it takes for
/// lit, for dark and for uncertain is sampled each for itself, by four shadow rays or six where channels
/// differ, so that what it guesses rightly has no noise.
Spectrum in_scattered_parallel_light(const World& world, uint32_t light, const ShadowMap& map,
                                     const MediumSegment& segment, int32_t medium, RandomStream& random,
                                     RayCounters& counters);

}  // namespace fogbank::transport
