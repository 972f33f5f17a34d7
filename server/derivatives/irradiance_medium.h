// Light that the medium sends to a side of a surface, cosine-weighted.
#pragma once

#include <vector>

#include "derivatives/hemisphere_rays.h"
#include "derivatives/radiance_jet.h"
#include "derivatives/source.h"

namespace fogbank::derivatives {

/// The cosine-weighted form factor that each vertex stands for.
using VertexForms = std::vector<Jet3d>;

struct MediumIrradiance {
  /// Irradiance over pi. The value is the mean over the rays, unbiased. Derivatives: a constant source,
  /// fitted to the rays, has the closed form of method.md section 8.3 and sees all outlines. What a ray
  /// brings beyond it counts as sent by one shell, through the medium, at the mean distance of the light that
  /// is scattered along it, integral of t T over that of T: the moments of section 8.4 then are those of a
  /// linear source. A medium's light has weak kinks only.
  RadianceJet mean;
  std::vector<Spectrum> radiance;  ///< of each cell
  double gradient_variance = 0;    ///< of the luminance's gradient, from the spread of neighbouring rays
};

/// `forms` are those of a mesh around the point, `vertices` where its vertices lie relative to that and
/// `rays_of` the vertex of the grid that each belongs to. Directions that don't leave outside bring no light
/// of the medium. Throws Interrupted.
MediumIrradiance gather_medium_irradiance(const transport::World& world, const LineSource& source,
                                          const HemisphereRays& rays, const VertexForms& forms,
                                          std::span<const Vec3d> vertices, std::span<const uint32_t> rays_of,
                                          RandomStream& random, RayCounters& counters);

}  // namespace fogbank::derivatives
