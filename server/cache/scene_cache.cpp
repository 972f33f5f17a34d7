#include "cache/scene_cache.h"

#include <chrono>
#include <utility>

#include "core/error.h"

namespace fogbank::cache {
namespace {

/// Rounds within this time are saved together: a segment costs some milliseconds of waiting for the disk, and
/// a crash costs no more than the records of that time.
constexpr std::chrono::seconds commit_delay{2};

}  // namespace

SceneCache::SceneCache(std::shared_ptr<SceneCache> original)
    : original_(std::move(original)), records_(original_->records()), epoch_(original_->epoch()) {}

SceneCache::SceneCache(std::shared_ptr<SceneCache> original, std::shared_ptr<const RecordSet> records,
                       std::shared_ptr<const RecordSet> all, Numbers spare)
    : original_(std::move(original)),
      spare_(std::move(all)),
      spare_numbers_(std::move(spare)),
      records_(std::move(records)),
      epoch_(original_->epoch()) {}

std::shared_ptr<SceneCache> SceneCache::fork(std::shared_ptr<SceneCache> original,
                                             std::span<const uint64_t> ids) {
  const std::shared_ptr<const RecordSet> all = original->records();
  Numbers numbers;
  numbers.reserve(all->size());
  for (size_t i = 0; i < all->size(); ++i) numbers.emplace(all->ids()[i], i);
  std::vector<Record> records;
  records.reserve(ids.size());
  for (const uint64_t id : ids) {
    const auto number = numbers.extract(id);
    if (number.empty()) return nullptr;
    records.push_back(all->record(number.mapped()));
  }
  auto set = numbers.empty() ? all : std::make_shared<const RecordSet>(std::move(records));
  return std::shared_ptr<SceneCache>(
      new SceneCache(std::move(original), std::move(set), all, std::move(numbers)));
}

std::optional<Record> SceneCache::spare(uint64_t id) const {
  const auto number = spare_numbers_.find(id);
  return number != spare_numbers_.end() ? std::optional(spare_->record(number->second)) : std::nullopt;
}

SceneCache::SceneCache(std::shared_ptr<StoredCache> stored, const scene::FieldIdentity& field)
    : stored_(std::move(stored)), emission_(field.emission), records_(std::make_shared<const RecordSet>()) {
  storage_.stored = true;
  load();
  writer_ = std::thread([this] { run_writer(); });
}

SceneCache::~SceneCache() {
  if (!writer_.joinable()) return;
  {
    const std::lock_guard lock(mutex_);
    ending_ = true;
  }
  changed_.notify_all();
  writer_.join();
}

std::shared_ptr<const RecordSet> SceneCache::records() const {
  const std::lock_guard lock(mutex_);
  return records_;
}

uint64_t SceneCache::epoch() const {
  const std::lock_guard lock(mutex_);
  return epoch_;
}

StorageState SceneCache::storage() const {
  if (original_ != nullptr) return original_->storage();
  const std::lock_guard lock(mutex_);
  StorageState state = storage_;
  for (const RecordSet& records : pending_) state.records_unsaved += records.size();
  return state;
}

void SceneCache::unite(RecordSet&& records) {
  const std::shared_ptr<const RecordSet> before = this->records();
  auto merged =
      std::make_shared<const RecordSet>(before->size() == 0 ? std::move(records) : merge(*before, records));
  if (merged->size() == before->size()) return;
  const std::lock_guard lock(mutex_);
  records_ = std::move(merged);
  ++epoch_;
}

void SceneCache::add(std::vector<Record> records) {
  if (records.empty()) return;
  if (original_ != nullptr) original_->add(records);
  RecordSet added(std::move(records));
  const std::lock_guard adding(adding_);
  if (stored_ != nullptr) {
    const std::lock_guard lock(mutex_);
    pending_.push_back(added);
    ++added_;
  }
  unite(std::move(added));
  changed_.notify_all();
}

void SceneCache::load() {
  LoadedRecords loaded;
  std::string problem;
  try {
    loaded = stored_->load(emission_);
  } catch (const std::exception& error) {
    problem = error.what();
  }
  const size_t count = loaded.records.size();
  const std::lock_guard adding(adding_);
  if (count > 0) unite(std::move(loaded.records));
  const std::lock_guard lock(mutex_);
  storage_.records_loaded = count;
  storage_.damages.insert(storage_.damages.end(), loaded.damages.begin(), loaded.damages.end());
  storage_.notes = std::move(loaded.notes);
  storage_.problem = std::move(problem);
}

void SceneCache::reload() {
  if (stored_ != nullptr) load();
}

void SceneCache::save() {
  if (original_ != nullptr) original_->save();
  if (stored_ == nullptr) return;
  std::unique_lock lock(mutex_);
  if (!pending_.empty()) ++added_;  // what couldn't be saved before is tried again
  const uint64_t wanted = added_;
  wanted_now_ = true;
  changed_.notify_all();
  changed_.wait(lock, [&] { return saved_ >= wanted; });
}

void SceneCache::run_writer() {
  std::unique_lock lock(mutex_);
  while (true) {
    changed_.wait(lock, [&] { return ending_ || wanted_now_ || added_ > saved_; });
    changed_.wait_for(lock, commit_delay, [&] { return ending_ || wanted_now_; });
    wanted_now_ = false;
    if (!pending_.empty()) save_pending(lock);
    if (ending_) return;
  }
}

void SceneCache::save_pending(std::unique_lock<std::mutex>& lock) {
  std::vector<RecordSet> taken = std::exchange(pending_, {});
  const uint64_t reached = added_;
  lock.unlock();
  RecordSet together;
  std::string problem;
  for (RecordSet& records : taken) together = merge(together, records);
  try {
    stored_->append(together, emission_);
  } catch (const std::exception& error) {
    problem = error.what();
  }
  lock.lock();
  if (!problem.empty()) pending_.push_back(std::move(together));
  saved_ = reached;
  storage_.problem = std::move(problem);
  changed_.notify_all();
}

}  // namespace fogbank::cache
