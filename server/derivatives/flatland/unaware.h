// Point-to-point derivatives that ignore visibility: the occlusion-unaware rival (Jarosz et al. 2008,
// "Radiance caching for participating media"; method.md section 9).
#pragma once

#include "derivatives/flatland/settings.h"
#include "derivatives/flatland/source.h"

namespace fogbank::derivatives::flatland {

/// Light straight from the segments (M_surf).
Estimate estimate_surfaces_unaware(const Scene& scene, const Settings& settings, const Vec2d& x);

/// Light from the medium (M_med). The Hessian's terms grow as 1/s^2 towards the point and their sum does not
/// converge with the step: it is there for comparison.
Estimate estimate_medium_unaware(const Scene& scene, const Source& source, const Settings& settings,
                                 const Vec2d& x);

}  // namespace fogbank::derivatives::flatland
