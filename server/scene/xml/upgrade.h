// Old syntax to that of Mitsuba 3.
#pragma once

#include <string>
#include <vector>

#include "scene/xml/document.h"

namespace fogbank::scene {

/// "maxDepth" -> "max_depth", "intIOR" -> "int_ior", "sigmaS" -> "sigma_s".
std::string snake_case(const std::string& name);

/// Rewrites one element of a 0.x file, whose children are upgraded already: names to snake case, `lookAt`,
/// texture offsets and scales to a `to_uv` transform, renamed and dropped parameters (a warning each where
/// something is lost).
void upgrade_element(XmlElement& element, std::vector<std::string>& warnings);

}  // namespace fogbank::scene
