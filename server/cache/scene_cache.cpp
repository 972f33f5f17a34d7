#include "cache/scene_cache.h"

namespace fogbank::cache {

std::shared_ptr<const RecordSet> SceneCache::records() const {
  const std::lock_guard lock(mutex_);
  return records_;
}

uint64_t SceneCache::epoch() const {
  const std::lock_guard lock(mutex_);
  return epoch_;
}

void SceneCache::add(std::vector<Record> records) {
  if (records.empty()) return;
  const RecordSet added(std::move(records));
  const std::lock_guard lock(mutex_);
  auto merged = std::make_shared<const RecordSet>(merge(*records_, added));
  if (merged->size() == records_->size()) return;
  records_ = std::move(merged);
  ++epoch_;
}

}  // namespace fogbank::cache
