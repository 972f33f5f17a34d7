// Lines of sight as the medium's gather wants them.
#pragma once

#include "derivatives/medium_gather.h"
#include "derivatives/sightlines.h"

namespace fogbank::derivatives {

/// One for each line of `lines`. Throws Interrupted.
std::vector<MediumRay> medium_rays(const Sightlines& lines, const RayCounters& counters = {});

}  // namespace fogbank::derivatives
