// Next-event estimation: light that reaches a point or a segment straight from the emitters, sampled at the
// emitters.
#pragma once

#include "core/random.h"
#include "transport/distance_table.h"
#include "transport/world.h"

namespace fogbank::transport {

/// How emission is found besides by sampling the emitters: decides the weights of multiple importance
/// sampling (power heuristic with exponent 2, Veach 1997 section 9.2.3).
enum class EmissionFoundBy : uint8_t {
  light_sampling,           ///< nothing else: full weight
  light_and_path_sampling,  ///< the path that goes on counts emission it meets
};

/// Power heuristic's weight of the strategy with `density` against one with `other`; safe where a density
/// overflows.
float power_heuristic(float density, float other);

/// What the light sampler needs to know of a surface that scatters. `cos_viewer`: cosine of the viewer's
/// direction to the shading normal.
LightReceiver receiver_at(const World& world, const scene::SurfaceInteraction& surface, const Bsdf& bsdf,
                          float cos_viewer, int32_t medium);

/// The table of distances for `samples` samples along one segment: the camera's segments, which take several,
/// get the finer one.
DistanceTable::Resolution resolution_for(int32_t samples);

/// Radiance scattered once in `segment` (through `medium`) against its direction, with the transmittance up
/// to its origin: distances by transmittance times the closed-form unoccluded proxy of one chosen light
/// (ratio-records.md sections 1 and 4), directions by the light's solid angle; mean of `samples` samples.
Spectrum in_scattered_radiance(const World& world, const MediumSegment& segment, int32_t medium,
                               int32_t samples, EmissionFoundBy found_by, RandomStream& random,
                               RayCounters& counters);

/// Radiance that `surface`, seen along `ray_direction` from `medium`, reflects and transmits of the light
/// that reaches it from the emitters; one sample.
Spectrum reflected_direct_light(const World& world, const scene::SurfaceInteraction& surface,
                                const Vec3f& ray_direction, int32_t medium, EmissionFoundBy found_by,
                                RandomStream& random, RayCounters& counters);

/// Mean radiance (fluence / 4 pi) that reaches a point from the emitters; one sample. Path sampling, if any,
/// draws its direction uniformly.
Spectrum mean_direct_light(const World& world, const Vec3f& position, int32_t medium,
                           EmissionFoundBy found_by, RandomStream& random, RayCounters& counters);

/// Light at a point of a medium, seen along a ray: W/(m^2 sr).
struct MediumLight {
  Spectrum scattered{0};  ///< against the ray, per unit of sigma_s
  Spectrum mean{0};       ///< mean radiance: the same where the phase function is isotropic
};

/// The light that reaches a point of `medium` from the emitters, seen along `ray_direction`: one sample for
/// both. Path sampling, if any, draws its direction from the phase function.
MediumLight scattered_direct_light(const World& world, const Vec3f& position, const Vec3f& ray_direction,
                                   int32_t medium, EmissionFoundBy found_by, RandomStream& random,
                                   RayCounters& counters);

}  // namespace fogbank::transport
