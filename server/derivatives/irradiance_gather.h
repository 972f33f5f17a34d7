// Irradiance of a side of a surface by light that doesn't come straight from an emitter, with occlusion-aware
// derivatives: the virtual triangulation of method.md section 2 over the hemisphere, cosine-weighted
// (Schwarzhaupt et al. 2012, "Practical Hessian-Based Error Control for Irradiance Caching", who weigh
// triangles by their farthest vertex).
#pragma once

#include "derivatives/hemisphere_rays.h"
#include "derivatives/radiance_jet.h"
#include "derivatives/source.h"

namespace fogbank::derivatives {

/// The light around a surface. What is referred to must outlive this.
struct IrradianceSources {
  const LineSource& lines;
  const SurfaceSource& surfaces;
};

struct IrradianceSettings {
  int32_t samples = 256;  ///< directions, rounded up to a square; at least 4
  bool bisect = true;     ///< outlines (method.md section 6.2)
};

struct IrradianceEstimate {
  /// Irradiance over pi: what a white Lambertian surface sends out. The value is the stratified mean of the
  /// rays, unbiased; derivatives are with respect to moving in the tangent plane, and have no component along
  /// the normal. Finite.
  RadianceJet mean;
  double variance = 0;           ///< of the luminance of `mean`, from the spread of neighbouring rays
  double gradient_variance = 0;  ///< of the luminance's gradient: sum over its components
};

/// Light from surfaces, their emission left out, and from the medium, along one ray a direction. Mean rule on
/// triangles between surfaces that meet, farthest rule on slanted ones, which outlines split first (method.md
/// sections 5 and 6.2); derivatives of the light from surfaces are scaled by the ratio of the two values
/// (section 6.1). Mirrors count as surfaces with a picture on them. Throws Interrupted.
IrradianceEstimate gather_irradiance(const transport::World& world, const IrradianceSources& sources,
                                     const SurfaceSide& side, const IrradianceSettings& settings,
                                     RandomStream& random, RayCounters& counters);

}  // namespace fogbank::derivatives
