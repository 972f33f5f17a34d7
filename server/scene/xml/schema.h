// Which elements there are and which attributes they may have.
#pragma once

#include <string>
#include <string_view>
#include <vector>

#include "scene/xml/document.h"

namespace fogbank::scene {

/// Elements that describe an object by a plugin: `<bsdf type="...">` and so on.
bool is_plugin_tag(std::string_view tag);

bool is_known_tag(std::string_view tag);

/// All elements of the language, sorted.
std::vector<std::string> known_tags();

/// Throws SceneError UNKNOWN_ATTRIBUTE (lenient: warns) for an attribute that the element doesn't have.
void check_attributes(const XmlElement& element, bool lenient, std::vector<std::string>& warnings);

/// Throws SceneError MISSING_ATTRIBUTE.
const std::string& required_attribute(const XmlElement& element, std::string_view attribute);

}  // namespace fogbank::scene
