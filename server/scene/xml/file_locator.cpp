#include "scene/xml/file_locator.h"

#include <algorithm>
#include <optional>

#include "scene/text.h"

namespace fogbank::scene {

void FileLocator::add_folder(const std::string& reference, const SourceLocation& where) {
  try {
    folders_.push_back(resolve_path(main_path_, reference) + "/");
  } catch (const Error& error) {
    throw SceneError(error.kind(), error.reason(), where, error.what());
  }
}

FileLocator::Located FileLocator::locate(const std::string& reference, const SourceLocation& where) {
  std::vector<std::string> bases = {main_path_};
  bases.insert(bases.end(), folders_.begin(), folders_.end());
  bases.push_back(where.file);

  Located located;
  std::optional<Error> refused;
  for (const std::string& base : bases) {
    try {
      const std::string path = resolve_path(base, reference);
      if (std::find(located.candidates.begin(), located.candidates.end(), path) == located.candidates.end())
        located.candidates.push_back(path);
    } catch (const Error& error) {
      if (!refused) refused = error;
    }
  }
  if (located.candidates.empty())
    throw SceneError(refused->kind(), refused->reason(), where, refused->what());

  for (const std::string& path : located.candidates)
    if (files_.exists(path)) {
      located.path = path;
      located.exists = true;
      break;
    }
  std::vector<std::string> wanted = {located.path};
  if (!located.exists) {
    located.path = located.candidates.front();
    wanted = located.candidates;
    for (const std::string& path : wanted) files_.note_missing(path);
  }
  for (const std::string& path : wanted)
    if (listed_.insert(path).second) references_.push_back(path);
  return located;
}

std::string FileLocator::read(const std::string& path, const SourceLocation& where) const {
  try {
    return files_.read(path);
  } catch (const Error& error) {
    throw SceneError(error.kind(), error.reason(), where, error.what());
  }
}

SceneError FileLocator::not_found(const Located& located, const SourceLocation& where) {
  std::string places;
  for (const std::string& path : located.candidates) places += (places.empty() ? "" : " or ") + quote(path);
  return {ErrorKind::not_found, "FILE_NOT_FOUND", where, "file " + places + " does not exist"};
}

}  // namespace fogbank::scene
