// Limits of XML text, checked on the text itself.
#pragma once

#include <string>
#include <string_view>

#include "scene/xml/document.h"

namespace fogbank::scene {

/// Counts elements, attributes and nesting in one pass without building anything, and throws as `read_xml`
/// says. Text that isn't well-formed passes: the parser reports it.
void check_xml_limits(std::string_view text, const std::string& file, int depth, XmlBudget& budget);

}  // namespace fogbank::scene
