#include "service/cache_registry.h"

#include <algorithm>

#include "service/limits.h"
#include "service/names.h"
#include "service/rpc_error.h"

namespace fogbank::service {

CacheRegistry::CacheRegistry(Settings settings) : settings_(std::move(settings)) {}

CacheRegistry::Entry& CacheRegistry::load(const std::string& fingerprint) {
  Entry& entry = entries_[fingerprint];
  entry.last_use = ++use_counter_;
  if (!entry.cache) entry.cache = std::make_shared<cache::SceneCache>();
  return entry;
}

std::shared_ptr<cache::SceneCache> CacheRegistry::acquire(const std::string& fingerprint) {
  const std::lock_guard lock(mutex_);
  std::shared_ptr<cache::SceneCache> cache = load(fingerprint).cache;
  make_room(fingerprint);
  return cache;
}

void CacheRegistry::make_room(const std::string& but) {
  while (true) {
    int64_t total = 0;
    Entry* oldest = nullptr;
    for (auto& [fingerprint, entry] : entries_) {
      if (!entry.cache) continue;
      total += static_cast<int64_t>(entry.cache->records()->memory());
      const bool in_use = entry.cache.use_count() > 1 || fingerprint == but;
      if (!in_use && (oldest == nullptr || entry.last_use < oldest->last_use)) oldest = &entry;
    }
    if (total <= settings_.memory_budget_bytes || oldest == nullptr) return;
    oldest->cache = nullptr;
    oldest->kept.clear();
  }
}

uint64_t CacheRegistry::keep_epoch(const std::string& fingerprint) {
  const std::lock_guard lock(mutex_);
  Entry& entry = load(fingerprint);
  KeptEpoch kept;
  do {
    kept.epoch = entry.cache->epoch();
    kept.records = entry.cache->records();
  } while (entry.cache->epoch() != kept.epoch);
  const uint64_t epoch = kept.epoch;
  std::erase_if(entry.kept, [&](const KeptEpoch& other) { return other.epoch == epoch; });
  entry.kept.push_back(std::move(kept));
  if (entry.kept.size() > static_cast<size_t>(limits::max_kept_epochs)) entry.kept.pop_front();
  return epoch;
}

std::shared_ptr<cache::SceneCache> CacheRegistry::at_epoch(const std::string& fingerprint, uint64_t epoch) {
  const std::lock_guard lock(mutex_);
  if (const auto found = entries_.find(fingerprint); found != entries_.end()) {
    for (const KeptEpoch& kept : found->second.kept) {
      if (kept.epoch == epoch) return std::make_shared<cache::SceneCache>(kept.records);
    }
  }
  throw RpcError(grpc::StatusCode::FAILED_PRECONDITION, "EPOCH_GONE",
                 "epoch " + std::to_string(epoch) + " of " + cache_name(fingerprint) +
                     " is not kept; fill the cache again",
                 {{"name", cache_name(fingerprint)}});
}

int64_t CacheRegistry::memory_bytes() const {
  const std::lock_guard lock(mutex_);
  int64_t total = 0;
  for (const auto& [fingerprint, entry] : entries_) {
    if (entry.cache) total += static_cast<int64_t>(entry.cache->records()->memory());
  }
  return total;
}

}  // namespace fogbank::service
