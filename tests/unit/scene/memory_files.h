// Scene files held in memory.
#pragma once

#include <map>
#include <string>
#include <utility>

#include "core/error.h"
#include "scene/file_source.h"

namespace fogbank::scene::test {

class MemoryFiles : public FileSource {
 public:
  explicit MemoryFiles(std::map<std::string, std::string> files) : files_(std::move(files)) {}

  bool exists(const std::string& path) const override { return files_.count(path) > 0; }
  std::string read(const std::string& path) const override {
    ++reads_;
    const auto file = files_.find(path);
    if (file == files_.end()) throw Error(ErrorKind::not_found, "FILE_NOT_FOUND", "no file '" + path + "'");
    return file->second;
  }
  int reads() const { return reads_; }

 private:
  std::map<std::string, std::string> files_;
  mutable int reads_ = 0;
};

}  // namespace fogbank::scene::test
