// SHA-256 of the files that a scene refers to, each computed once.
#pragma once

#include <map>
#include <string>
#include <string_view>

#include "core/sha256.h"
#include "scene/file_source.h"

namespace fogbank::scene {

class ContentHashes {
 public:
  explicit ContentHashes(const FileSource& files) : files_(files) {}

  /// Saves a second reading of a file that was just read.
  void note(const std::string& path, std::string_view bytes) {
    if (hashes_.count(path) == 0) hashes_[path] = sha256(bytes);
  }

  const std::string& hash(const std::string& path) {
    const auto known = hashes_.find(path);
    if (known != hashes_.end()) return known->second;
    return hashes_[path] = sha256(files_.read(path));
  }

 private:
  const FileSource& files_;
  std::map<std::string, std::string> hashes_;
};

}  // namespace fogbank::scene
