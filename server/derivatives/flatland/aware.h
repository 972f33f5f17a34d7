// Occlusion-aware estimates: neighbouring directions are joined to segments, and a sum over fixed segments is
// differentiated (method.md sections 2 to 8).
#pragma once

#include "derivatives/flatland/settings.h"
#include "derivatives/flatland/source.h"

namespace fogbank::derivatives::flatland {

/// Light straight from the segments (M_surf).
Estimate estimate_surfaces_aware(const Scene& scene, const Settings& settings, const Vec2d& x);

/// Light from the medium (M_med), marched in steps of `settings.march_step` > 0.
Estimate estimate_medium_aware(const Scene& scene, const Source& source, const Settings& settings,
                               const Vec2d& x);

}  // namespace fogbank::derivatives::flatland
