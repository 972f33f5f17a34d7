#include "scene/xml/document.h"

#include <algorithm>
#include <pugixml.hpp>

#include "scene/loader.h"
#include "scene/text.h"
#include "scene/utf8.h"
#include "scene/xml/limits.h"

namespace fogbank::scene {
namespace {

/// Refuses what isn't plain UTF-8 and returns the text without its byte order mark.
std::string_view checked_text(std::string_view bytes, const std::string& file) {
  const SourceLocation where{file, 0, ""};
  if (bytes.size() > LoadLimits::xml_bytes)
    throw SceneError(ErrorKind::resource_exhausted, "XML_TOO_LARGE", where,
                     "the file has " + std::to_string(bytes.size()) + " bytes; at most " +
                         std::to_string(LoadLimits::xml_bytes) + " are read");
  if (bytes.starts_with("\xFF\xFE") || bytes.starts_with("\xFE\xFF") || bytes.substr(0, 4).find('\0') < 4)
    throw SceneError(ErrorKind::invalid_argument, "XML_ENCODING", where,
                     "the file is not UTF-8 (it looks like UTF-16 or UTF-32); save it as UTF-8");
  if (bytes.starts_with("\xEF\xBB\xBF")) bytes.remove_prefix(3);
  const size_t nul = bytes.find('\0');
  if (nul != std::string_view::npos) {
    const auto line =
        static_cast<int>(std::count(bytes.begin(), bytes.begin() + static_cast<long>(nul), '\n')) + 1;
    throw SceneError(ErrorKind::invalid_argument, "XML_ENCODING", {file, line, ""}, "a NUL byte is not text");
  }
  if (!is_valid_utf8(bytes))
    throw SceneError(ErrorKind::invalid_argument, "XML_ENCODING", where, "the file is not valid UTF-8");
  return bytes;
}

/// Byte offsets to lines.
class LineIndex {
 public:
  explicit LineIndex(std::string_view text) {
    starts_.push_back(0);
    for (size_t i = 0; i < text.size(); ++i)
      if (text[i] == '\n') starts_.push_back(i + 1);
  }
  /// 1-based.
  int line(size_t offset) const {
    return static_cast<int>(std::upper_bound(starts_.begin(), starts_.end(), offset) - starts_.begin());
  }
  /// 1-based, in bytes.
  int column(size_t offset) const {
    return static_cast<int>(offset - starts_[static_cast<size_t>(line(offset)) - 1]) + 1;
  }

 private:
  std::vector<size_t> starts_;
};

XmlElement convert(const pugi::xml_node& node, const std::string& file, const LineIndex& lines, int depth) {
  // check_xml_limits has counted already; this bound holds even if the two should read odd text differently.
  if (depth > LoadLimits::depth)
    throw SceneError(ErrorKind::resource_exhausted, "XML_TOO_DEEP",
                     {file, lines.line(static_cast<size_t>(node.offset_debug())), ""},
                     "elements are nested more than " + std::to_string(LoadLimits::depth) + " deep");
  XmlElement element;
  element.tag = node.name();
  for (const pugi::xml_attribute& attribute : node.attributes())
    element.attributes.push_back({attribute.name(), attribute.value()});
  element.where.file = file;
  element.where.line = lines.line(static_cast<size_t>(std::max<ptrdiff_t>(node.offset_debug(), 0)));
  element.update_label();
  for (size_t i = 0; i < element.attributes.size(); ++i)
    for (size_t j = 0; j < i; ++j)
      if (element.attributes[i].name == element.attributes[j].name)
        throw SceneError(ErrorKind::invalid_argument, "XML_MALFORMED", element.where,
                         "attribute " + quote(element.attributes[i].name) + " is given twice");
  for (const pugi::xml_node& child : node.children())
    if (child.type() == pugi::node_element)
      element.children.push_back(convert(child, file, lines, depth + 1));
  return element;
}

}  // namespace

const std::string* XmlElement::find(std::string_view attribute) const {
  for (const XmlAttribute& candidate : attributes)
    if (candidate.name == attribute) return &candidate.value;
  return nullptr;
}

const std::string& XmlElement::get(std::string_view attribute) const {
  static const std::string nothing;
  const std::string* value = find(attribute);
  return value ? *value : nothing;
}

void XmlElement::set(std::string_view attribute, const std::string& value) {
  for (XmlAttribute& candidate : attributes)
    if (candidate.name == attribute) {
      candidate.value = value;
      return;
    }
  attributes.push_back({std::string(attribute), value});
}

void XmlElement::update_label() {
  where.element = "<" + tag;
  for (const char* attribute : {"type", "id", "name"})
    if (const std::string* value = find(attribute)) {
      const std::string quoted = quote(*value);
      where.element += std::string(" ") + attribute + "=\"" + quoted.substr(1, quoted.size() - 2) + "\"";
    }
  where.element += '>';
}

XmlElement read_xml(std::string_view bytes, const std::string& file, int depth, XmlBudget& budget) {
  const std::string_view text = checked_text(bytes, file);
  check_xml_limits(text, file, depth, budget);
  const LineIndex lines(text);
  pugi::xml_document document;
  const pugi::xml_parse_result result =
      document.load_buffer(text.data(), text.size(), pugi::parse_default, pugi::encoding_utf8);
  if (!result) {
    const auto offset = static_cast<size_t>(std::max<ptrdiff_t>(result.offset, 0));
    throw SceneError(
        ErrorKind::invalid_argument, "XML_MALFORMED", {file, lines.line(offset), ""},
        "malformed XML at column " + std::to_string(lines.column(offset)) + ": " + result.description());
  }
  pugi::xml_node root;
  for (const pugi::xml_node& node : document.children()) {
    if (node.type() != pugi::node_element) continue;
    if (root)
      throw SceneError(ErrorKind::invalid_argument, "XML_MALFORMED",
                       {file, lines.line(static_cast<size_t>(node.offset_debug())), ""},
                       "a second root element <" + std::string(node.name()) + ">");
    root = node;
  }
  return convert(root, file, lines, depth + 1);
}

}  // namespace fogbank::scene
