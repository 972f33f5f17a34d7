// A file that is removed when nobody needs it any more.
#pragma once

#include <filesystem>
#include <system_error>
#include <utility>

namespace fogbank::service {

class TemporaryFile {
 public:
  TemporaryFile() = default;
  /// Takes over a file that need not exist yet.
  explicit TemporaryFile(std::filesystem::path path) : path_(std::move(path)) {}
  ~TemporaryFile() { remove(); }
  TemporaryFile(TemporaryFile&& other) noexcept : path_(std::exchange(other.path_, {})) {}
  TemporaryFile& operator=(TemporaryFile&& other) noexcept {
    if (this != &other) {
      remove();
      path_ = std::exchange(other.path_, {});
    }
    return *this;
  }

  const std::filesystem::path& path() const { return path_; }

 private:
  void remove() {
    if (path_.empty()) return;
    std::error_code ignored;
    std::filesystem::remove(path_, ignored);
  }

  std::filesystem::path path_;
};

}  // namespace fogbank::service
