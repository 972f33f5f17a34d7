// XML text to a tree of elements, with every limit checked before memory is spent on it.
#pragma once

#include <string>
#include <string_view>
#include <vector>

#include "core/error.h"

namespace fogbank::scene {

struct XmlAttribute {
  std::string name;
  std::string value;
};

/// One element. Text between elements, comments and processing instructions are dropped.
struct XmlElement {
  std::string tag;
  std::vector<XmlAttribute> attributes;  ///< in file order
  std::vector<XmlElement> children;
  SourceLocation where;
  bool is_legacy = false;  ///< from a file of version 0.x

  const std::string* find(std::string_view attribute) const;
  /// Value of an attribute, "" when absent.
  const std::string& get(std::string_view attribute) const;
  void set(std::string_view attribute, const std::string& value);
  /// Writes `where.element` anew, e.g. `<shape type="obj" id="wall">`.
  void update_label();
};

/// What the files of one scene may still use up.
struct XmlBudget {
  int elements;
  int attributes;
};

/// Root element of `bytes`. Only UTF-8 (with or without byte order mark) is read, and no document type with
/// declarations: entities could refer to other files or multiply. Throws SceneError: XML_MALFORMED with line
/// and column, XML_ENCODING, XML_DOCTYPE_REFUSED, and resource_exhausted XML_TOO_LARGE, XML_TOO_DEEP,
/// XML_TOO_MANY_ELEMENTS, XML_ATTRIBUTE_TOO_LONG. `depth` is the number of elements around this file.
XmlElement read_xml(std::string_view bytes, const std::string& file, int depth, XmlBudget& budget);

}  // namespace fogbank::scene
