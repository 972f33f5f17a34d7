// Lines of sight as the medium's gather wants them.
#pragma once

#include "derivatives/medium_gather.h"
#include "derivatives/sightlines.h"

namespace fogbank::derivatives {

/// One for each line of `lines`.
std::vector<MediumRay> medium_rays(const Sightlines& lines);

}  // namespace fogbank::derivatives
