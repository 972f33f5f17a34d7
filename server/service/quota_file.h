// What each tenant may use of the server, as `fogbank quota` writes it.
#pragma once

#include <cstdint>
#include <filesystem>
#include <map>
#include <mutex>
#include <optional>
#include <string>
#include <string_view>

#include "service/watched_file.h"

namespace fogbank::service {

/// Most that a tenant may have; nothing: what the limits of the server allow.
struct Quota {
  std::optional<int64_t> jobs;          ///< that have not ended
  std::optional<int64_t> stored_bytes;  ///< files, scenes, images and checkpoints on the disk
  std::optional<int64_t> cache_bytes;   ///< radiance caches on the disk
  std::optional<int64_t> watchers;      ///< open WatchJob streams
  std::optional<double> cpu_seconds;    ///< of render threads in any window
  double window_seconds = 3600;
};

/// `quotas.json` in the data directory: {"version": 1, "quotas": {tenant: {"jobs", "stored_bytes",
/// "cache_bytes", "watchers", "cpu_seconds", "window_seconds"}}}, numbers or null; the tenant "*" is
/// everybody who has no entry. Read as WatchedFile. Thread-safe.
class QuotaFile {
 public:
  explicit QuotaFile(std::filesystem::path path);

  Quota of(std::string_view tenant);

 private:
  using Quotas = std::map<std::string, Quota, std::less<>>;

  static Quotas parse(const std::string& text);

  std::mutex mutex_;
  WatchedFile<Quotas> file_;
};

}  // namespace fogbank::service
