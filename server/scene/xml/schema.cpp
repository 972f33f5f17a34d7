#include "scene/xml/schema.h"

#include <algorithm>
#include <map>

#include "scene/text.h"

namespace fogbank::scene {
namespace {

using AttributeTable = std::map<std::string, std::vector<std::string>, std::less<>>;

constexpr const char* plugin_tags[] = {"bsdf",    "emitter", "film",   "integrator", "medium",  "phase",
                                       "rfilter", "sampler", "sensor", "shape",      "texture", "volume"};

const AttributeTable& attribute_table() {
  static const AttributeTable table = [] {
    AttributeTable made = {
        {"alias", {"id", "as"}},
        {"boolean", {"name", "value"}},
        {"default", {"name", "value"}},
        {"float", {"name", "value"}},
        {"include", {"filename"}},
        {"integer", {"name", "value"}},
        {"lookat", {"origin", "target", "up"}},
        {"matrix", {"value"}},
        {"path", {"value"}},
        {"point", {"name", "value", "x", "y", "z"}},
        {"ref", {"name", "id"}},
        {"rgb", {"name", "value", "intent"}},
        {"rotate", {"value", "x", "y", "z", "angle"}},
        {"scale", {"value", "x", "y", "z"}},
        {"scene", {"version"}},
        {"spectrum", {"name", "value", "filename", "type", "id", "intent"}},
        {"srgb", {"name", "value", "intent"}},
        {"string", {"name", "value"}},
        {"transform", {"name"}},
        {"translate", {"value", "x", "y", "z"}},
        {"vector", {"name", "value", "x", "y", "z"}},
    };
    for (const char* tag : plugin_tags) made[tag] = {"type", "id", "name"};
    return made;
  }();
  return table;
}

}  // namespace

bool is_plugin_tag(std::string_view tag) {
  return std::find(std::begin(plugin_tags), std::end(plugin_tags), tag) != std::end(plugin_tags);
}

bool is_known_tag(std::string_view tag) { return attribute_table().find(tag) != attribute_table().end(); }

std::vector<std::string> known_tags() {
  std::vector<std::string> tags;
  for (const auto& entry : attribute_table()) tags.push_back(entry.first);
  return tags;
}

void check_attributes(const XmlElement& element, bool lenient, std::vector<std::string>& warnings) {
  const auto entry = attribute_table().find(element.tag);
  if (entry == attribute_table().end()) return;
  for (const XmlAttribute& attribute : element.attributes) {
    if (std::find(entry->second.begin(), entry->second.end(), attribute.name) != entry->second.end())
      continue;
    const std::string message = "unknown attribute " + quote(attribute.name);
    if (!lenient)
      throw SceneError(ErrorKind::invalid_argument, "UNKNOWN_ATTRIBUTE", element.where,
                       message + "; supported: " + list_names(entry->second) +
                           did_you_mean(attribute.name, entry->second));
    warnings.push_back(element.where.to_string() + ": " + message + " is ignored");
  }
}

const std::string& required_attribute(const XmlElement& element, std::string_view attribute) {
  const std::string* value = element.find(attribute);
  if (!value)
    throw SceneError(ErrorKind::invalid_argument, "MISSING_ATTRIBUTE", element.where,
                     "attribute " + quote(attribute) + " is missing");
  return *value;
}

}  // namespace fogbank::scene
