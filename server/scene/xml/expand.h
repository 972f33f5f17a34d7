// A scene's files as one tree: parameters substituted, includes inlined, old syntax upgraded.
#pragma once

#include <map>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "scene/loader.h"
#include "scene/xml/document.h"
#include "scene/xml/file_locator.h"

namespace fogbank::scene {

struct SceneAlias {
  std::string id;  ///< of an object
  std::string as;  ///< another id for it
  SourceLocation where;
};

/// Expands `<default>`, `<include>`, `<path>` and `<alias>` in document order.
class SceneExpander {
 public:
  /// `tolerant` (for listing references): includes that are missing and parameters that are not defined are
  /// passed over.
  SceneExpander(FileLocator& locator, const LoadOptions& options, bool tolerant);

  /// The `<scene>` element with everything inlined. Throws SceneError: as `read_xml`; NOT_A_SCENE,
  /// UNSUPPORTED_VERSION, UNDEFINED_PARAMETER, UNUSED_PARAMETER, INCLUDE_CYCLE, TOO_MANY_INCLUDES,
  /// FILE_NOT_FOUND, MISPLACED_ELEMENT.
  XmlElement expand(const std::string& main_path);

  const std::vector<SceneAlias>& aliases() const { return aliases_; }
  std::vector<std::string>& warnings() { return warnings_; }

 private:
  struct Context {
    int depth = 0;
    bool is_legacy = false;
    bool is_top_level = true;
  };

  XmlElement read_file(const std::string& path, const SourceLocation& where, Context& context);
  void expand_into(XmlElement& parent, XmlElement element, Context context);
  void include(XmlElement& parent, const XmlElement& element, Context context);
  void define(const XmlElement& element);
  void read_version(const XmlElement& root, Context& context);
  void substitute(XmlElement& element);
  std::string substituted(const std::string& text, const SourceLocation& where);

  FileLocator& locator_;
  bool is_lenient_;
  bool is_tolerant_;
  std::map<std::string, std::string> parameters_;
  std::set<std::string> unused_;  ///< parameters of the caller that no `$name` has asked for
  std::vector<std::string> open_files_;
  int include_count_ = 0;
  XmlBudget budget_{LoadLimits::elements, LoadLimits::attributes};
  std::vector<SceneAlias> aliases_;
  std::vector<std::string> warnings_;
};

}  // namespace fogbank::scene
