// The radiance cache of one scene: what every job that renders the scene reads and adds to.
#pragma once

#include <cstdint>
#include <memory>
#include <mutex>
#include <vector>

#include "cache/record_set.h"

namespace fogbank::cache {

/// Grow-only. Thread-safe; what `records` gave never changes.
class SceneCache {
 public:
  SceneCache() : records_(std::make_shared<const RecordSet>()) {}
  explicit SceneCache(std::shared_ptr<const RecordSet> records) : records_(std::move(records)) {}
  virtual ~SceneCache() = default;
  SceneCache(const SceneCache&) = delete;
  SceneCache& operator=(const SceneCache&) = delete;

  /// All records there are.
  std::shared_ptr<const RecordSet> records() const;
  /// Number of times that records were added.
  uint64_t epoch() const;
  /// Union with `records`; a new epoch unless nothing is new. Throws Error(invalid_argument,
  /// "INVALID_RECORD"), and nothing is added then.
  void add(std::vector<Record> records);

 private:
  mutable std::mutex mutex_;
  std::shared_ptr<const RecordSet> records_;
  uint64_t epoch_ = 0;
};

}  // namespace fogbank::cache
