// Light that the medium sends to a side of a surface, cosine-weighted: method.md section 8 over a hemisphere.
#pragma once

#include <vector>

#include "derivatives/hemisphere_rays.h"
#include "derivatives/radiance_jet.h"
#include "derivatives/source.h"

namespace fogbank::derivatives {

/// The cosine-weighted form factor that each vertex stands for.
using VertexForms = std::vector<Jet3d>;

struct MediumIrradiance {
  /// Irradiance over pi. The value is the stratified mean, unbiased. Derivatives: the constant part of the
  /// source sees all outlines; what the source differs from it is taken to be seen wherever its samples are
  /// (weak kinks), on shells around the point.
  RadianceJet mean;
  std::vector<Spectrum> radiance;  ///< of each cell
  double gradient_variance = 0;    ///< of the luminance's gradient, from the spread of neighbouring rays
};

/// `forms` are those of the mesh whose first vertices are the grid's, `rays_of` tells each vertex's ray;
/// `vertices` are the mesh's, relative to the point. Rays that don't leave outside carry no light of the
/// medium. Throws Interrupted.
MediumIrradiance gather_medium_irradiance(const transport::World& world, const MediumSource& source,
                                          const HemisphereRays& rays, const VertexForms& forms,
                                          std::span<const Vec3d> vertices, std::span<const uint32_t> rays_of,
                                          RandomStream& random, RayCounters& counters);

}  // namespace fogbank::derivatives
