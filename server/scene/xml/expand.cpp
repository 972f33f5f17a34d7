#include "scene/xml/expand.h"

#include <algorithm>

#include "scene/text.h"
#include "scene/xml/schema.h"
#include "scene/xml/upgrade.h"
#include "scene/xml/values.h"

namespace fogbank::scene {
namespace {

/// Bounds the search for the longest defined name in `$name...`.
constexpr size_t longest_parameter_name = 64;

bool is_name_character(char c) {
  return (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9') || c == '_';
}

}  // namespace

SceneExpander::SceneExpander(FileLocator& locator, const LoadOptions& options, bool tolerant)
    : locator_(locator),
      is_lenient_(options.lenient),
      is_tolerant_(tolerant),
      parameters_(options.parameters) {
  for (const auto& parameter : parameters_) unused_.insert(parameter.first);
}

XmlElement SceneExpander::expand(const std::string& main_path) {
  Context context;
  XmlElement root = read_file(main_path, {main_path, 0, ""}, context);
  if (root.tag != "scene")
    throw SceneError(ErrorKind::invalid_argument, "NOT_A_SCENE", root.where,
                     "the root element must be <scene>");
  XmlElement scene{root.tag, root.attributes, {}, root.where, context.is_legacy};
  context.depth = 1;
  for (XmlElement& child : root.children) expand_into(scene, std::move(child), context);
  open_files_.pop_back();
  if (!unused_.empty() && !is_tolerant_) {
    const std::string& name = *unused_.begin();
    const std::string message = "parameter " + quote(name) + " is not used by the scene";
    if (!is_lenient_) throw SceneError(ErrorKind::invalid_argument, "UNUSED_PARAMETER", root.where, message);
    warnings_.push_back(root.where.to_string() + ": " + message);
  }
  return scene;
}

XmlElement SceneExpander::read_file(const std::string& path, const SourceLocation& where, Context& context) {
  open_files_.push_back(path);
  const std::string bytes = locator_.read(path, where);
  XmlElement root = read_xml(bytes, path, context.depth, budget_);
  read_version(root, context);
  return root;
}

void SceneExpander::read_version(const XmlElement& root, Context& context) {
  const std::string* version = root.find("version");
  if (!version) {
    if (root.tag == "scene") {
      context.is_legacy = false;
      warnings_.push_back(root.where.to_string() + ": no 'version' attribute; read as version 3");
    }
    return;
  }
  const size_t point = std::min(version->find('.'), version->size());
  const auto major = parse_integer(std::string_view(*version).substr(0, point));
  if (!major || *major < 0 || *major > 3)
    throw SceneError(ErrorKind::unsupported, "UNSUPPORTED_VERSION", root.where,
                     "version " + quote(*version) + " is not supported; supported: 0.x, 2.x, 3.x");
  context.is_legacy = *major < 2;
}

void SceneExpander::expand_into(XmlElement& parent, XmlElement element, Context context) {
  if (++context.depth > LoadLimits::depth)
    throw SceneError(ErrorKind::resource_exhausted, "XML_TOO_DEEP", element.where,
                     "elements are nested more than " + std::to_string(LoadLimits::depth) + " deep");
  substitute(element);
  element.is_legacy = context.is_legacy;
  const bool is_directive = element.tag == "default" || element.tag == "path" || element.tag == "alias";
  if (is_directive || element.tag == "include") {
    check_attributes(element, is_lenient_, warnings_);
    if (is_directive && !context.is_top_level)
      throw SceneError(ErrorKind::invalid_argument, "MISPLACED_ELEMENT", element.where,
                       "may only stand directly in <scene>");
  }
  if (element.tag == "default") return define(element);
  if (element.tag == "include") return include(parent, element, context);
  if (element.tag == "path") return locator_.add_folder(required_attribute(element, "value"), element.where);
  if (element.tag == "alias") {
    aliases_.push_back({required_attribute(element, "id"), required_attribute(element, "as"), element.where});
    return;
  }
  XmlElement expanded{element.tag, std::move(element.attributes), {}, element.where, context.is_legacy};
  context.is_top_level = false;
  for (XmlElement& child : element.children) expand_into(expanded, std::move(child), context);
  if (expanded.is_legacy) upgrade_element(expanded, warnings_);
  parent.children.push_back(std::move(expanded));
}

void SceneExpander::include(XmlElement& parent, const XmlElement& element, Context context) {
  if (++include_count_ > LoadLimits::includes)
    throw SceneError(ErrorKind::resource_exhausted, "TOO_MANY_INCLUDES", element.where,
                     "more than " + std::to_string(LoadLimits::includes) + " files are included");
  const std::string& reference = required_attribute(element, "filename");
  if (is_tolerant_ && reference.find('$') != std::string::npos) return;
  const FileLocator::Located located = locator_.locate(reference, element.where);
  if (!located.exists) {
    if (is_tolerant_) return;
    throw FileLocator::not_found(located, element.where);
  }
  if (std::find(open_files_.begin(), open_files_.end(), located.path) != open_files_.end())
    throw SceneError(ErrorKind::invalid_argument, "INCLUDE_CYCLE", element.where,
                     "file " + quote(located.path) + " includes itself");
  XmlElement root = read_file(located.path, element.where, context);
  if (root.tag == "scene") {
    // The included <scene> counts as one level: read_xml has checked its text with the depth around it.
    for (XmlElement& child : root.children) expand_into(parent, std::move(child), context);
  } else {
    std::erase_if(root.attributes, [](const XmlAttribute& attribute) { return attribute.name == "version"; });
    expand_into(parent, std::move(root), context);
  }
  open_files_.pop_back();
}

void SceneExpander::define(const XmlElement& element) {
  const std::string& name = required_attribute(element, "name");
  if (name.empty() || name.size() > longest_parameter_name ||
      !std::all_of(name.begin(), name.end(), is_name_character))
    throw SceneError(ErrorKind::invalid_argument, "INVALID_VALUE", element.where,
                     "parameter names consist of at most 64 letters, digits and '_'");
  parameters_.emplace(name, required_attribute(element, "value"));
}

void SceneExpander::substitute(XmlElement& element) {
  bool is_changed = false;
  for (XmlAttribute& attribute : element.attributes) {
    if (attribute.value.find('$') == std::string::npos) continue;
    attribute.value = substituted(attribute.value, element.where);
    is_changed = true;
  }
  if (is_changed) element.update_label();
}

std::string SceneExpander::substituted(const std::string& text, const SourceLocation& where) {
  std::string result;
  size_t i = 0;
  while (i < text.size()) {
    if (text[i] != '$') {
      result += text[i++];
      continue;
    }
    size_t end = i + 1;
    while (end < text.size() && is_name_character(text[end])) ++end;
    // As in Mitsuba, a name may be followed by letters: the longest defined one counts.
    size_t used_end = std::min(end, i + 1 + longest_parameter_name);
    while (used_end > i + 1 && !parameters_.count(text.substr(i + 1, used_end - i - 1))) --used_end;
    if (used_end == i + 1) {
      if (!is_tolerant_) {
        std::vector<std::string> names;
        for (const auto& parameter : parameters_) names.push_back(parameter.first);
        const std::string name = text.substr(i + 1, end - i - 1);
        throw SceneError(ErrorKind::invalid_argument, "UNDEFINED_PARAMETER", where,
                         "parameter " + quote("$" + name) + " is not defined; defined: " +
                             (names.empty() ? "none" : list_names(names)) + did_you_mean(name, names));
      }
      result += text.substr(i, end - i);
    } else {
      const std::string name = text.substr(i + 1, used_end - i - 1);
      unused_.erase(name);
      result += parameters_[name];
      end = used_end;
    }
    if (result.size() > LoadLimits::attribute_bytes)
      throw SceneError(ErrorKind::resource_exhausted, "XML_ATTRIBUTE_TOO_LONG", where,
                       "an attribute has more than " + std::to_string(LoadLimits::attribute_bytes) +
                           " bytes after its parameters were filled in");
    i = end;
  }
  return result;
}

}  // namespace fogbank::scene
