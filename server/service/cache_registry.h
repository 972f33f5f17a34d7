// The radiance caches that the server keeps: one for each radiance fingerprint, shared by all jobs.
#pragma once

#include <cstdint>
#include <deque>
#include <filesystem>
#include <map>
#include <memory>
#include <mutex>
#include <string>

#include "cache/scene_cache.h"
#include "fogbank/v1/cache.pb.h"

namespace fogbank::service {

/// In memory, the least recently used caches go when all of them are above the budget; those that somebody
/// uses stay. Thread-safe. May wait for the disk: not for gRPC reactions.
class CacheRegistry {
 public:
  struct Settings {
    std::filesystem::path folder;
    int64_t memory_budget_bytes = 0;
    int64_t disk_budget_bytes = 0;
  };

  explicit CacheRegistry(Settings settings);

  /// The records of a scene, from the disk where they aren't in memory.
  std::shared_ptr<cache::SceneCache> acquire(const std::string& fingerprint);

  /// Keeps the newest epoch for `at_epoch`, until max_kept_epochs later ones of the same cache were kept; its
  /// number.
  uint64_t keep_epoch(const std::string& fingerprint);
  /// The records as they were at an epoch that was kept; nobody else's records are added. Throws RpcError
  /// EPOCH_GONE.
  std::shared_ptr<cache::SceneCache> at_epoch(const std::string& fingerprint, uint64_t epoch);

  int64_t memory_bytes() const;

 private:
  struct KeptEpoch {
    uint64_t epoch = 0;
    std::shared_ptr<const cache::RecordSet> records;
  };
  struct Entry {
    std::shared_ptr<cache::SceneCache> cache;  ///< null while not in memory
    std::deque<KeptEpoch> kept;                ///< oldest first
    uint64_t last_use = 0;
  };

  /// With `mutex_` held.
  Entry& load(const std::string& fingerprint);
  void make_room(const std::string& but);

  Settings settings_;
  mutable std::mutex mutex_;
  std::map<std::string, Entry> entries_;  ///< by fingerprint
  uint64_t use_counter_ = 0;
};

}  // namespace fogbank::service
