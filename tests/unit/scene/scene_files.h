// Scene files for tests, written to a folder of their own.
#pragma once

#include <gtest/gtest.h>
#include <stdlib.h>

#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <memory>
#include <string>

#include "core/error.h"
#include "scene/file_source.h"

namespace fogbank::scene::test {

/// A new folder, removed with everything in it at the end.
class TemporaryFolder {
 public:
  TemporaryFolder() {
    std::string pattern = (std::filesystem::temp_directory_path() / "fogbank-XXXXXX").string();
    if (::mkdtemp(pattern.data()) == nullptr) throw std::runtime_error("no temporary folder");
    path_ = pattern;
  }
  ~TemporaryFolder() { std::filesystem::remove_all(path_); }
  TemporaryFolder(const TemporaryFolder&) = delete;
  TemporaryFolder& operator=(const TemporaryFolder&) = delete;

  const std::filesystem::path& path() const { return path_; }

  TemporaryFolder& write(const std::string& name, const std::string& bytes) {
    const std::filesystem::path file = path_ / name;
    std::filesystem::create_directories(file.parent_path());
    std::ofstream(file, std::ios::binary) << bytes;
    return *this;
  }

  std::shared_ptr<FileSource> source() const { return folder_source(path_.string()); }

 private:
  std::filesystem::path path_;
};

/// Reason and message of the Error that `action` throws; empty when it throws none.
struct Thrown {
  std::string reason;
  std::string message;
};

template <typename Action>
Thrown thrown_by(const Action& action) {
  try {
    action();
  } catch (const Error& error) {
    return {error.reason(), error.what()};
  }
  return {};
}

}  // namespace fogbank::scene::test
