// The sum over a light's triangles, with what blockers do to them.
#pragma once

#include "derivatives/estimator.h"
#include "derivatives/seen_grid.h"
#include "derivatives/silhouettes.h"

namespace fogbank::derivatives {

/// Adds light that every blocker's outline cuts where `silhouettes` says; without any crossing nothing is
/// blocked, and what comes out is the closed form (exact where the transmittance is 1). Method.md sections 2,
/// 5 and 6: the outline's strips have no area and carry the light's own weight. `settings.sliding` and
/// `settings.corners` add the terms of section 6.4.
void add_cut_grid(const SeenGrid& seen, const Silhouettes& silhouettes, const EstimatorSettings& settings,
                  RadianceJet& sum);

/// Without bisection: the value is the mean over the vertices' visibility, gradient and Hessian are the
/// farthest rule's. They are not scaled by the ratio of the two values, as method.md section 6.1 does for
/// spheres of directions: a light's grid ends where the light does, and the scaling doubled the gradient's
/// error in penumbrae (scenes/penumbra, 8 x 8 cells: 22 instead of 12 %). `far_distance` stands for infinity.
void add_plain_grid(const SeenGrid& seen, double far_distance, const EstimatorSettings& settings,
                    RadianceJet& sum);

}  // namespace fogbank::derivatives
