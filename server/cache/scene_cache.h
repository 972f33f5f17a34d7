// The radiance cache of one scene: what every job that renders the scene reads and adds to.
#pragma once

#include <condition_variable>
#include <cstdint>
#include <memory>
#include <mutex>
#include <optional>
#include <span>
#include <string>
#include <thread>
#include <unordered_map>
#include <vector>

#include "cache/record_set.h"
#include "cache/store/store.h"

namespace fogbank::cache {

/// How the records of a cache stand on the disk.
struct StorageState {
  bool stored = false;             ///< is there a folder behind the cache at all
  uint64_t records_loaded = 0;     ///< from it so far
  uint64_t records_unsaved = 0;    ///< added here and not on the disk yet
  std::string problem;             ///< why saving or loading failed last; "" where all is well
  std::vector<Damage> damages;     ///< files that couldn't be used
  std::vector<std::string> notes;  ///< what became of records of other emissions, in sentences
};

/// Grow-only. Thread-safe; what `records` gave never changes. With a folder behind it, a thread of its own
/// saves what was added: rounds that follow each other quickly go into one segment, and nobody waits. If
/// saving fails the records stay in memory, and are saved with the next.
class SceneCache {
 public:
  SceneCache() : SceneCache(std::make_shared<const RecordSet>()) {}
  explicit SceneCache(std::shared_ptr<const RecordSet> records) : records_(std::move(records)) {}
  /// A fork: begins with what `original` holds, and what is added here is added there, too; what others add
  /// there never comes here.
  explicit SceneCache(std::shared_ptr<SceneCache> original);
  /// A fork that begins with those of the original's records that have these ids, for a job that began when
  /// there were no others; null if one is missing.
  static std::shared_ptr<SceneCache> fork(std::shared_ptr<SceneCache> original,
                                          std::span<const uint64_t> ids);
  /// What `stored` holds, for the emission that `field` is of, and all that is added later goes there. A
  /// folder that can't be read or written is a problem of storage(), not of the cache.
  SceneCache(std::shared_ptr<StoredCache> stored, const scene::FieldIdentity& field);
  /// Saves.
  ~SceneCache();
  SceneCache(const SceneCache&) = delete;
  SceneCache& operator=(const SceneCache&) = delete;

  /// All records there are.
  std::shared_ptr<const RecordSet> records() const;
  /// Number of times that records were added.
  uint64_t epoch() const;
  /// Union with `records`; a new epoch unless nothing is new. Throws Error(invalid_argument,
  /// "INVALID_RECORD"), and nothing is added then. Nobody who asks for records() waits meanwhile.
  void add(std::vector<Record> records);

  /// Of such a fork: a record that the original held when it was made, and that the fork began without: what
  /// an interrupted job made last, for who would make it again.
  std::optional<Record> spare(uint64_t id) const;

  /// Waits until all that was added is on the disk, or saving failed (storage().problem). Of a fork: the
  /// original's, as its storage() is.
  void save();
  /// Union with what is in the folder by now: imports, records of other processes.
  void reload();
  StorageState storage() const;

 private:
  void load();
  void unite(RecordSet&& records);
  void run_writer();
  void save_pending(std::unique_lock<std::mutex>& lock);

  /// Which record of the original has an id.
  using Numbers = std::unordered_map<uint64_t, size_t>;

  SceneCache(std::shared_ptr<SceneCache> original, std::shared_ptr<const RecordSet> records,
             std::shared_ptr<const RecordSet> all, Numbers spare);

  std::shared_ptr<SceneCache> original_;    ///< of a fork
  std::shared_ptr<const RecordSet> spare_;  ///< of a fork: all that the original held; or null
  Numbers spare_numbers_;                   ///< in that, of those that the fork began without
  std::shared_ptr<StoredCache> stored_;
  std::vector<Spectrum> emission_;
  std::mutex adding_;         ///< one union at a time
  mutable std::mutex mutex_;  ///< what follows; held for moments
  std::condition_variable changed_;
  std::shared_ptr<const RecordSet> records_;
  uint64_t epoch_ = 0;
  std::vector<RecordSet> pending_;  ///< added, not on the disk
  uint64_t added_ = 0;              ///< calls of add() and save() that had something to save
  uint64_t saved_ = 0;              ///< of them, tried to save
  bool wanted_now_ = false;         ///< someone waits for the disk
  bool ending_ = false;
  StorageState storage_;
  std::thread writer_;  ///< only with a folder
};

}  // namespace fogbank::cache
