#include "service/cache_registry.h"

#include <spdlog/spdlog.h>

#include <algorithm>
#include <bit>
#include <limits>

#include "core/error.h"
#include "service/cache_messages.h"
#include "service/limits.h"
#include "service/names.h"
#include "service/rpc_error.h"

namespace fogbank::service {

namespace fs = std::filesystem;
using grpc::StatusCode;

namespace {

std::string key_of(const scene::FieldIdentity& field) {
  std::string key = field.transport;
  for (const Spectrum& emission : field.emission) {
    for (int channel = 0; channel < 3; ++channel)
      key += " " + std::to_string(std::bit_cast<uint32_t>(emission[channel]));
  }
  return key;
}

RpcError not_found(const std::string& transport) {
  return {StatusCode::NOT_FOUND,
          "CACHE_NOT_FOUND",
          "there is no " + cache_name(transport),
          {{"name", cache_name(transport)}}};
}

}  // namespace

CacheRegistry::CacheRegistry(Settings settings)
    : settings_(std::move(settings)),
      transfer_folder_(settings_.folder / "transfers"),
      store_(settings_.folder / "fields") {
  fs::remove_all(transfer_folder_);
  fs::create_directories(transfer_folder_);
}

CacheRegistry::Entry& CacheRegistry::load(const scene::FieldIdentity& field) {
  Entry& entry = entries_[key_of(field)];
  entry.transport = field.transport;
  entry.last_use = ++use_counter_;
  if (!entry.cache) entry.cache = std::make_shared<cache::SceneCache>(store_.cache(field.transport), field);
  return entry;
}

std::shared_ptr<cache::SceneCache> CacheRegistry::acquire(const scene::FieldIdentity& field) {
  const std::lock_guard lock(mutex_);
  Entry& entry = load(field);
  make_room(entry);
  return entry.cache;
}

void CacheRegistry::make_room(const Entry& but) {
  while (true) {
    int64_t total = 0;
    Entry* oldest = nullptr;
    for (auto& [key, entry] : entries_) {
      if (!entry.cache) continue;
      total += static_cast<int64_t>(entry.cache->records()->memory());
      const bool in_use = entry.cache.use_count() > 1 || &entry == &but;
      if (!in_use && (oldest == nullptr || entry.last_use < oldest->last_use)) oldest = &entry;
    }
    if (total <= memory_budget_bytes_ || oldest == nullptr) return;
    oldest->cache = nullptr;
    oldest->kept.clear();
  }
}

uint64_t CacheRegistry::keep_epoch(const scene::FieldIdentity& field) {
  const std::shared_ptr<cache::SceneCache> cache = acquire(field);
  cache->save();
  KeptEpoch kept;
  do {
    kept.epoch = cache->epoch();
    kept.records = cache->records();
  } while (cache->epoch() != kept.epoch);
  const uint64_t epoch = kept.epoch;
  const std::lock_guard lock(mutex_);
  std::deque<KeptEpoch>& all = load(field).kept;
  std::erase_if(all, [&](const KeptEpoch& other) { return other.epoch == epoch; });
  all.push_back(std::move(kept));
  if (all.size() > static_cast<size_t>(limits::max_kept_epochs)) all.pop_front();
  return epoch;
}

std::shared_ptr<cache::SceneCache> CacheRegistry::at_epoch(const scene::FieldIdentity& field,
                                                           uint64_t epoch) {
  const std::lock_guard lock(mutex_);
  if (const auto found = entries_.find(key_of(field)); found != entries_.end()) {
    for (const KeptEpoch& kept : found->second.kept) {
      if (kept.epoch == epoch) return std::make_shared<cache::SceneCache>(kept.records);
    }
  }
  throw RpcError(StatusCode::FAILED_PRECONDITION, "EPOCH_GONE",
                 "epoch " + std::to_string(epoch) + " of " + cache_name(field.transport) +
                     " is not kept; fill the cache again",
                 {{"name", cache_name(field.transport)}});
}

std::vector<std::shared_ptr<cache::SceneCache>> CacheRegistry::loaded(const std::string& transport) {
  const std::lock_guard lock(mutex_);
  std::vector<std::shared_ptr<cache::SceneCache>> caches;
  for (const auto& [key, entry] : entries_) {
    if (entry.transport == transport && entry.cache) caches.push_back(entry.cache);
  }
  return caches;
}

std::shared_ptr<cache::StoredCache> CacheRegistry::existing(const std::string& transport) {
  for (const auto& cache : loaded(transport)) cache->save();
  try {
    return store_.existing(transport);
  } catch (const Error& error) {
    if (error.kind() == ErrorKind::not_found) throw not_found(transport);
    throw;
  }
}

int64_t CacheRegistry::memory_of(const std::string& transport) const {
  int64_t total = 0;
  for (const auto& [key, entry] : entries_) {
    if (entry.cache && (transport.empty() || entry.transport == transport))
      total += static_cast<int64_t>(entry.cache->records()->memory());
  }
  return total;
}

int64_t CacheRegistry::memory_bytes() const {
  const std::lock_guard lock(mutex_);
  return memory_of("");
}

v1::Cache CacheRegistry::describe(const std::string& transport) {
  v1::Cache message = to_message(existing(transport)->describe());
  const std::lock_guard lock(mutex_);
  message.set_memory_bytes(memory_of(transport));
  return message;
}

v1::ListCachesResponse CacheRegistry::list(int page_size, const std::string& page_token) {
  const auto wanted = effective_page_size(page_size);
  if (!page_token.empty()) {
    try {
      parse_cache_name(page_token);
    } catch (const RpcError&) {
      throw RpcError(StatusCode::INVALID_ARGUMENT, "INVALID_PAGE_TOKEN",
                     "page_token is not one of this server's", {{"field", "page_token"}});
    }
  }
  std::set<std::string> transports;
  {
    const std::lock_guard lock(mutex_);
    for (const auto& [key, entry] : entries_) transports.insert(entry.transport);
  }
  for (const std::string& transport : transports) {
    for (const auto& cache : loaded(transport)) cache->save();
  }
  v1::ListCachesResponse response;
  for (const std::string& transport : store_.list()) {
    if (!page_token.empty() && cache_name(transport) <= page_token) continue;
    if (response.caches_size() == wanted) {
      response.set_next_page_token(response.caches(wanted - 1).name());
      break;
    }
    try {
      *response.add_caches() = describe(transport);
      response.mutable_caches()->rbegin()->clear_components();
    } catch (const RpcError& error) {
      // Removed in between.
      if (error.code() != StatusCode::NOT_FOUND) throw;
      response.mutable_caches()->RemoveLast();
    }
  }
  return response;
}

v1::VerifyCacheResponse CacheRegistry::verify(const std::string& transport) {
  const std::shared_ptr<cache::StoredCache> stored = existing(transport);
  const cache::VerifyReport report = stored->verify();
  v1::VerifyCacheResponse response;
  int64_t records = 0;
  int64_t bytes = 0;
  int32_t damaged = 0;
  for (const cache::SegmentReport& segment : report.segments) {
    bytes += static_cast<int64_t>(segment.segment.bytes);
    if (segment.damage) {
      ++damaged;
    } else {
      records += static_cast<int64_t>(segment.segment.records);
    }
  }
  response.set_records(records);
  response.set_segments(static_cast<int32_t>(report.segments.size()));
  response.set_damaged_segments(damaged + static_cast<int32_t>(report.other_damages.size()));
  response.set_bytes(bytes);
  return response;
}

void CacheRegistry::export_to(const std::string& transport, const fs::path& file) {
  existing(transport)->export_to(file);
}

void CacheRegistry::require_room_for(const std::vector<fs::path>& files) const {
  uint64_t records = 0;
  for (const fs::path& file : files) records += cache::describe_export(file).records;
  const std::lock_guard lock(mutex_);
  const auto most = static_cast<uint64_t>(memory_budget_bytes_) / sizeof(cache::Record);
  if (records <= most) return;
  throw RpcError(StatusCode::RESOURCE_EXHAUSTED, "CACHE_TOO_LARGE",
                 std::to_string(records) + " records are more than the " + std::to_string(most) +
                     " that the memory for caches has room for");
}

v1::ImportCacheResponse CacheRegistry::import_from(const fs::path& file, const std::string& transport) {
  require_room_for({file});
  const std::string field = transport.empty() ? cache::describe_export(file).transport : transport;
  for (const auto& cache : loaded(field)) cache->save();
  const std::shared_ptr<cache::StoredCache> stored = store_.cache(field);
  const uint64_t before = stored->describe().records;
  stored->import_from(file);
  // Records that were there already are in two segments now; united they count once.
  stored->compact();
  for (const auto& cache : loaded(field)) cache->reload();
  v1::ImportCacheResponse response;
  *response.mutable_cache() = describe(field);
  response.set_records_new(response.cache().records() - static_cast<int64_t>(before));
  return response;
}

v1::CollectCacheGarbageResponse CacheRegistry::collect_garbage(std::optional<int64_t> budget) {
  if (budget && *budget < 0) {
    throw RpcError(StatusCode::INVALID_ARGUMENT, "INVALID_BUDGET", "budget_bytes must not be negative",
                   {{"field", "budget_bytes"}});
  }
  std::set<std::string> in_use;
  {
    const std::lock_guard lock(mutex_);
    for (const auto& [key, entry] : entries_) {
      if (entry.cache && entry.cache.use_count() > 1) in_use.insert(entry.transport);
    }
  }
  const int64_t limit = budget ? *budget : settings_.disk_budget_bytes;
  const cache::GarbageReport report = store_.collect_garbage(
      budget || limit > 0 ? static_cast<uint64_t>(limit) : std::numeric_limits<uint64_t>::max(), in_use);
  {
    // A cache that is gone from the disk is gone from memory, or its records would come back.
    const std::lock_guard lock(mutex_);
    for (const std::string& transport : report.removed)
      std::erase_if(entries_, [&](const auto& item) { return item.second.transport == transport; });
  }
  v1::CollectCacheGarbageResponse response;
  for (const std::string& transport : report.removed) response.add_removed(cache_name(transport));
  response.set_bytes_before(static_cast<int64_t>(report.bytes_freed + report.bytes_left));
  response.set_bytes_after(static_cast<int64_t>(report.bytes_left));
  return response;
}

void CacheRegistry::keep_within_budget(std::optional<int64_t> quota) {
  std::optional<int64_t> budget = quota;
  if (settings_.disk_budget_bytes > 0)
    budget = std::min(settings_.disk_budget_bytes, quota.value_or(settings_.disk_budget_bytes));
  if (!budget) return;
  try {
    uint64_t total = 0;
    for (const std::string& transport : store_.list()) {
      const cache::CacheSummary summary = store_.cache(transport)->describe();
      total += summary.bytes + summary.quarantined_bytes;
    }
    if (total > static_cast<uint64_t>(*budget)) collect_garbage(budget);
  } catch (const std::exception& error) {
    spdlog::warn("caches are not kept within their budget: {}", error.what());
  }
}

void CacheRegistry::remove(const std::string& transport) {
  existing(transport);
  {
    const std::lock_guard lock(mutex_);
    std::erase_if(entries_, [&](const auto& item) { return item.second.transport == transport; });
  }
  store_.remove(transport);
}

void CacheRegistry::set_memory_budget(int64_t bytes) {
  const std::lock_guard lock(mutex_);
  memory_budget_bytes_ = bytes;
}

}  // namespace fogbank::service
