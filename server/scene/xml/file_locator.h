// Where the files lie that a scene refers to.
#pragma once

#include <set>
#include <string>
#include <vector>

#include "core/error.h"
#include "scene/file_source.h"

namespace fogbank::scene {

/// Looks up references as Mitsuba does: in the folder of the main file, whichever included file they stand
/// in, then in the folders of `<path>` elements, and last in the folder of the file they stand in.
class FileLocator {
 public:
  struct Located {
    std::string path;  ///< the first candidate that exists, else the first of all
    bool exists = false;
    std::vector<std::string> candidates;  ///< every place that counts, in order
  };

  FileLocator(FileSource& files, std::string main_path) : files_(files), main_path_(std::move(main_path)) {}

  /// `<path value="...">`, relative to the main file. Throws SceneError PATH_OUTSIDE_ROOT.
  void add_folder(const std::string& reference, const SourceLocation& where);

  /// Notes all candidates as missing in the file source when none exists. Throws SceneError PATH_OUTSIDE_ROOT
  /// when no candidate lies below the root.
  Located locate(const std::string& reference, const SourceLocation& where);

  /// Contents of a path; errors get `where` in front.
  std::string read(const std::string& path, const SourceLocation& where) const;

  /// The error for a reference that was located nowhere.
  static SceneError not_found(const Located& located, const SourceLocation& where);

  /// Every path that was located or, where none exists, every candidate; each once, in order.
  const std::vector<std::string>& references() const { return references_; }

 private:
  FileSource& files_;
  std::string main_path_;
  std::vector<std::string> folders_;
  std::vector<std::string> references_;
  std::set<std::string> listed_;
};

}  // namespace fogbank::scene
