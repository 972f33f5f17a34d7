// The sum over a light's triangles: form factor times transmittance times radiance, with derivatives.
#pragma once

#include "derivatives/estimator.h"
#include "derivatives/light_grid.h"
#include "derivatives/media_path.h"
#include "derivatives/silhouettes.h"

namespace fogbank::derivatives {

/// A grid, and what lies between x and each of its vertices.
struct SeenGrid {
  const LightGrid& grid;
  const std::vector<MediaPath>& paths;
  const std::vector<uint8_t>& visible;
};

/// Adds light that every blocker's outline cuts where `silhouettes` says; without any crossing nothing is
/// blocked, and what comes out is the closed form (exact where the transmittance is 1). Method.md sections 2,
/// 5 and 6: mean rule on whole triangles, the far side's weight on the strips that stand for outlines,
/// which have no area. `settings.sliding` and `settings.corners` add the terms of section 6.4.
void add_cut_grid(const SeenGrid& seen, const Silhouettes& silhouettes, const EstimatorSettings& settings,
                  RadianceJet& sum);

/// Without bisection: the value is the mean over the vertices' visibility; gradient and Hessian are the
/// farthest rule's, scaled by the ratio of that value to the farthest rule's own (method.md section 6.1).
/// `blockers`: per vertex, the distance of what blocks it; read where a neighbour is visible. `far_distance`
/// stands for infinity.
void add_plain_grid(const SeenGrid& seen, const std::vector<double>& blockers, double far_distance,
                    const EstimatorSettings& settings, RadianceJet& sum);

}  // namespace fogbank::derivatives
