// `<medium>` elements.
#pragma once

#include <string>
#include <vector>

#include "scene/description.h"
#include "scene/medium.h"

namespace fogbank::scene {

/// Homogeneous medium: `sigma_t` (default 1) and `albedo` (default 0.75), or `sigma_s` and `sigma_a`; `scale`
/// (default 1) multiplies the coefficients; each a float, rgb, spectrum or `constvolume`; one `<phase>`.
/// Throws SceneError: OUT_OF_RANGE, CONFLICTING_PARAMETERS, UNKNOWN_PLUGIN, and unsupported
/// HETEROGENEOUS_MEDIUM_UNSUPPORTED. `warnings` as in `PropertyReader::finish`.
Medium read_medium(const ObjectDescription& description, std::vector<std::string>* warnings);

}  // namespace fogbank::scene
