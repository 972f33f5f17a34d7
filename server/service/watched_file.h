// Files that the operator changes while the server runs.
#pragma once

#include <spdlog/spdlog.h>

#include <chrono>
#include <cstdint>
#include <exception>
#include <filesystem>
#include <functional>
#include <optional>
#include <string>
#include <utility>

#include "core/files.h"
#include "service/scheduling/clock.h"

namespace fogbank::service {

/// What a file says: looked at again when it changes, at most a second later. While it can't be read, what it
/// said before counts; where there is none, a Content{}. Not thread-safe.
template <typename Content>
class WatchedFile {
 public:
  /// `parse` throws for a text that makes no sense.
  WatchedFile(std::filesystem::path path, std::function<Content(const std::string&)> parse)
      : path_(std::move(path)), parse_(std::move(parse)) {}

  const Content& get() {
    const Clock::time_point now = Clock::now();
    if (now < next_look_) return content_;
    next_look_ = now + std::chrono::seconds(1);
    try {
      if (!std::filesystem::exists(path_)) {
        content_ = {};
        version_.reset();
        return content_;
      }
      const Version version{.time = std::filesystem::last_write_time(path_),
                            .size = std::filesystem::file_size(path_)};
      if (version_ == version) return content_;
      content_ = parse_(read_file(path_, max_file_bytes));
      version_ = version;
    } catch (const std::exception& error) {
      spdlog::error("{} can't be read, what it said before counts: {}", path_.filename().string(),
                    error.what());
    }
    return content_;
  }

 private:
  static constexpr int64_t max_file_bytes = 16 << 20;

  struct Version {
    std::filesystem::file_time_type time;
    uintmax_t size = 0;
    bool operator==(const Version&) const = default;
  };

  const std::filesystem::path path_;
  const std::function<Content(const std::string&)> parse_;
  Content content_{};
  std::optional<Version> version_;
  Clock::time_point next_look_;
};

}  // namespace fogbank::service
