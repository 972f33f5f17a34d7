// Indirect irradiance at a surface point with occlusion-aware derivatives: the virtual triangulation of
// method.md section 2 over the hemisphere, cosine-weighted.
#pragma once

#include "derivatives/hemisphere_grid.h"
#include "derivatives/radiance_jet.h"
#include "transport/path_tracer.h"

namespace fogbank::derivatives {

struct IrradianceEstimate {
  /// Irradiance / pi: what a white Lambertian surface sends out. Derivatives are with respect to the point,
  /// as if the hemisphere's plane moved with it; meaningful along the surface.
  RadianceJet mean;
  double variance = 0;                 ///< of the luminance of `mean`, from the spread of neighbouring rays
  float nearest = infinity;            ///< distance to the nearest surface seen
  float harmonic_distance = infinity;  ///< harmonic mean distance, by cosine
};

/// One estimate: light that arrives from surfaces (their emission left out where a light is sampled) and from
/// the medium. `normal`: unit, to the side that is lit; `medium`: on that side. `depth`: scattering events
/// between the camera and this one, the one at the surface included. One path for each of the (n + 1)^2
/// vertices.
IrradianceEstimate gather_irradiance(const transport::PathTracer& kernel, const HemisphereGrid& grid,
                                     const scene::SurfaceInteraction& surface, const Vec3f& normal,
                                     int32_t medium, int32_t depth, RandomStream& random,
                                     RayCounters& counters);

}  // namespace fogbank::derivatives
