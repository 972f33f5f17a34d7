// The radiance caches that the server keeps, in memory and on the disk, shared by all jobs.
#pragma once

#include <cstdint>
#include <deque>
#include <filesystem>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <set>
#include <string>
#include <vector>

#include "cache/scene_cache.h"
#include "cache/store/store.h"
#include "fogbank/v1/cache.pb.h"

namespace fogbank::service {

/// A cache is named by the transport fingerprint of its field (scene::FieldIdentity); in memory there is one
/// set of records for each emission that is in use. The least recently used go when all of them are above the
/// budget; those that somebody uses stay. Thread-safe. May wait for the disk: not for gRPC reactions.
class CacheRegistry {
 public:
  struct Settings {
    std::filesystem::path folder;
    int64_t disk_budget_bytes = 0;  ///< 0: no limit
  };

  explicit CacheRegistry(Settings settings);

  /// Memory of the caches from the next one on, in bytes; none at first.
  void set_memory_budget(int64_t bytes);

  /// The records of a field, from the disk where they aren't in memory.
  std::shared_ptr<cache::SceneCache> acquire(const scene::FieldIdentity& field);

  /// Saves the records and keeps the newest epoch for `at_epoch`, until max_kept_epochs later ones of the
  /// same field were kept; its number.
  uint64_t keep_epoch(const scene::FieldIdentity& field);
  /// The records as they were at an epoch that was kept; nobody else's records are added. Throws RpcError
  /// EPOCH_GONE.
  std::shared_ptr<cache::SceneCache> at_epoch(const scene::FieldIdentity& field, uint64_t epoch);

  /// Throws RpcError CACHE_NOT_FOUND.
  v1::Cache describe(const std::string& transport);
  /// Throws RpcError INVALID_PAGE_SIZE, INVALID_PAGE_TOKEN.
  v1::ListCachesResponse list(int page_size, const std::string& page_token);
  /// Throws RpcError CACHE_NOT_FOUND, and as cache::StoredCache::verify.
  v1::VerifyCacheResponse verify(const std::string& transport);
  /// All records as one file. Throws RpcError CACHE_NOT_FOUND, and as cache::StoredCache::export_to.
  void export_to(const std::string& transport, const std::filesystem::path& file);
  /// Adds an exported file to the cache that it is of, which must be `transport` unless that is empty. Throws
  /// as `require_room_for` and cache::StoredCache::import_from.
  v1::ImportCacheResponse import_from(const std::filesystem::path& file, const std::string& transport);
  /// To be asked before files that nobody vouches for are read: a few bytes of a compressed file can stand
  /// for much. Throws RpcError CACHE_TOO_LARGE unless the records of all exported files together, as their
  /// headers have it, fit into the memory for caches; and as cache::describe_export.
  void require_room_for(const std::vector<std::filesystem::path>& files) const;
  /// Down to `budget` bytes; nothing: to the budget of the settings.
  v1::CollectCacheGarbageResponse collect_garbage(std::optional<int64_t> budget);
  /// Removes whole caches while all together are above the budget of the settings or above `quota` bytes;
  /// what fails is logged.
  void keep_within_budget(std::optional<int64_t> quota);
  /// Throws RpcError CACHE_NOT_FOUND.
  void remove(const std::string& transport);

  int64_t memory_bytes() const;
  /// For files that are on their way to clients; emptied when the server starts.
  const std::filesystem::path& transfer_folder() const { return transfer_folder_; }

 private:
  struct KeptEpoch {
    uint64_t epoch = 0;
    std::shared_ptr<const cache::RecordSet> records;
  };
  struct Entry {
    std::string transport;
    std::shared_ptr<cache::SceneCache> cache;  ///< null while not in memory
    std::deque<KeptEpoch> kept;                ///< oldest first
    uint64_t last_use = 0;
  };

  /// These with `mutex_` held.
  Entry& load(const scene::FieldIdentity& field);
  void make_room(const Entry& but);
  int64_t memory_of(const std::string& transport) const;

  /// The caches in memory that are of this field, whatever their emission.
  std::vector<std::shared_ptr<cache::SceneCache>> loaded(const std::string& transport);
  std::shared_ptr<cache::StoredCache> existing(const std::string& transport);

  Settings settings_;
  std::filesystem::path transfer_folder_;
  cache::Store store_;
  mutable std::mutex mutex_;
  int64_t memory_budget_bytes_ = 0;
  std::map<std::string, Entry> entries_;  ///< by transport fingerprint and emission
  uint64_t use_counter_ = 0;
};

}  // namespace fogbank::service
