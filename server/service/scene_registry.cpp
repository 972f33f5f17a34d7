#include "service/scene_registry.h"

#include <google/protobuf/util/time_util.h>
#include <spdlog/spdlog.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <iterator>

#include "core/failpoint.h"
#include "core/files.h"
#include "core/sha256.h"
#include "service/limits.h"
#include "service/messages.h"
#include "service/names.h"
#include "service/rpc_error.h"

namespace fogbank::service {

namespace fs = std::filesystem;
using grpc::StatusCode;

namespace {

/// Request ids beyond this are forgotten, oldest first. A retry is then answered by the content of its
/// request, so that nothing is lost but the check that an id is not used twice.
constexpr size_t max_remembered_requests = 10000;

/// The same for requests that bring the same files and options, in whatever order.
std::string source_key(const v1::CreateSceneRequest& request) {
  v1::CreateSceneRequest source = request;
  source.clear_request_id();
  if (source.has_manifest()) {
    std::ranges::sort(*source.mutable_manifest()->mutable_entries(), {}, &v1::ManifestEntry::path);
  }
  return sha256(canonical_bytes(source));
}

RpcError not_found(const std::string& id) {
  return {
      StatusCode::NOT_FOUND, "SCENE_NOT_FOUND", "there is no " + scene_name(id), {{"name", scene_name(id)}}};
}

/// Sorts by age, and is a page token: creation time in nanoseconds, 20 digits, and the name.
std::string page_key(const v1::Scene& scene) {
  const int64_t time = google::protobuf::util::TimeUtil::TimestampToNanoseconds(scene.create_time());
  std::string digits = std::to_string(time);
  digits.insert(0, 20 - std::min<size_t>(digits.size(), 20), '0');
  return digits + " " + scene.name();
}

}  // namespace

SceneRegistry::SceneRegistry(Settings settings, BlobStore& blobs, TaskQueue& loader, ReaderHost& readers)
    : settings_(std::move(settings)), blobs_(blobs), loader_(loader), readers_(readers) {
  create_folder_durably(settings_.folder);
  restore();
}

void SceneRegistry::restore() {
  for (const auto& folder : fs::directory_iterator(settings_.folder)) {
    try {
      Entry entry;
      read_message(folder.path() / "scene.json", entry.description);
      read_message(folder.path() / "request.json", entry.source);
      const std::string id = parse_scene_name(entry.description.name());
      const std::string key = source_key(entry.source);
      if (entry.source.has_manifest()) id_by_source_[key] = id;
      source_by_request_[entry.source.request_id()] = key;
      scenes_.emplace(id, std::move(entry));
    } catch (const std::exception& error) {
      spdlog::warn("scene folder {} is passed over: {}", folder.path().filename().string(), error.what());
    }
  }
}

v1::Scene SceneRegistry::describe(const Entry& entry) const {
  v1::Scene description = entry.description;
  description.set_resident(entry.world != nullptr);
  return description;
}

void SceneRegistry::create(const v1::CreateSceneRequest& request, Created done) {
  check_request_id(request.request_id());
  check_source(request, settings_.scene_root);
  const std::string key = source_key(request);
  std::unique_lock lock(mutex_);
  const auto [known, is_new] = source_by_request_.emplace(request.request_id(), key);
  if (!is_new && known->second != key) {
    throw RpcError(StatusCode::ALREADY_EXISTS, "REQUEST_ID_REUSED",
                   "request_id was used before for another scene", {{"field", "request_id"}});
  }
  if (is_new) {
    request_order_.push_back(request.request_id());
    if (request_order_.size() > max_remembered_requests) {
      source_by_request_.erase(request_order_.front());
      request_order_.pop_front();
    }
  }
  // A server file may have changed since it was read, so it is read again.
  const auto by_source = id_by_source_.find(key);
  if (request.has_manifest() && by_source != id_by_source_.end()) {
    Entry& entry = scenes_.at(by_source->second);
    if (entry.world) {
      entry.last_use = ++use_counter_;
      const v1::Scene scene = describe(entry);
      lock.unlock();
      done(scene, true, nullptr);
      return;
    }
  } else if (scenes_.size() + loading_.size() >= static_cast<size_t>(limits::max_scenes)) {
    throw RpcError(StatusCode::RESOURCE_EXHAUSTED, "TOO_MANY_SCENES",
                   "the server knows as many scenes as it may; delete some", {{"limit", "max_scenes"}});
  }
  load_shared(request, "",
              [this, done = std::move(done), request_id = request.request_id()](const LoadedScene* loaded,
                                                                                std::exception_ptr error) {
                if (loaded == nullptr) {
                  // A scene that failed leaves its request id free: the client may mend the files and retry.
                  {
                    const std::lock_guard relock(mutex_);
                    source_by_request_.erase(request_id);
                  }
                  done({}, false, std::move(error));
                  return;
                }
                done(loaded->description, false, nullptr);
              });
}

void SceneRegistry::acquire(const std::string& id, Acquired done) {
  std::unique_lock lock(mutex_);
  const auto found = scenes_.find(id);
  if (found == scenes_.end()) throw not_found(id);
  Entry& entry = found->second;
  entry.last_use = ++use_counter_;
  if (entry.world) {
    const auto world = entry.world;
    lock.unlock();
    done(world, 0, nullptr);
    return;
  }
  load_shared(entry.source, id,
              [done = std::move(done)](const LoadedScene* loaded, std::exception_ptr error) {
                if (loaded == nullptr) {
                  done(nullptr, 0, std::move(error));
                } else {
                  done(loaded->world, loaded->description.load_times().total_seconds(), nullptr);
                }
              });
}

void SceneRegistry::load_shared(const v1::CreateSceneRequest& source, const std::string& expected_id,
                                std::function<void(const LoadedScene*, std::exception_ptr)> done) {
  if (shut_down_) throw shutting_down();
  const std::string key = source_key(source);
  if (const auto loading = loading_.find(key); loading != loading_.end()) {
    loading->second.waiting.push_back(std::move(done));
    return;
  }
  if (loading_.size() >= static_cast<size_t>(limits::max_queued_scene_loads)) {
    throw RpcError(StatusCode::RESOURCE_EXHAUSTED, "TOO_MANY_LOADS",
                   "too many scenes wait to be loaded; retry later", {{"limit", "max_queued_scene_loads"}});
  }
  Loading loading{.source = source, .waiting = {}};
  loading.waiting.push_back(std::move(done));
  loading_.emplace(key, std::move(loading));
  if (!loader_.post([this, key, expected_id] { run_loading(key, expected_id); })) {
    loading_.erase(key);
    throw shutting_down();
  }
}

void SceneRegistry::run_loading(const std::string& key, const std::string& expected_id) {
  v1::CreateSceneRequest source;
  {
    const std::lock_guard lock(mutex_);
    if (shut_down_) {
      loading_.erase(key);  // nobody waits any more
      return;
    }
    source = loading_.at(key).source;
  }
  LoadedScene loaded;
  std::exception_ptr error;
  try {
    loaded = load(source, settings_.scene_root, blobs_, readers_);
    if (!expected_id.empty() && loaded.id != expected_id) {
      throw RpcError(
          StatusCode::FAILED_PRECONDITION, "SCENE_CHANGED",
          "the files of " + scene_name(expected_id) + " have changed since it was created; create it again",
          {{"name", scene_name(expected_id)}});
    }
    // Durable before it is acknowledged; scene.json comes last, as it makes the folder valid. A scene that is
    // loaded again has it all.
    if (expected_id.empty()) {
      const fs::path folder = settings_.folder / loaded.id;
      create_folder_durably(folder);
      FOGBANK_FAILPOINT("scene.before_request");
      write_message(folder / "request.json", source);
      FOGBANK_FAILPOINT("scene.before_description");
      write_message(folder / "scene.json", loaded.description);
      FOGBANK_FAILPOINT("scene.after_description");
    }
    spdlog::info("loaded {} ({}) in {:.3f} s: {} triangles", loaded.description.name(),
                 loaded.description.main_path(), loaded.description.load_times().total_seconds(),
                 loaded.description.statistics().triangles());
  } catch (...) {
    error = std::current_exception();
  }

  std::vector<std::shared_ptr<const transport::World>> released;
  Loading loading;
  {
    const std::lock_guard lock(mutex_);
    if (!error) released = keep(loaded, source);
    loading = std::move(loading_.extract(key).mapped());
  }
  for (const auto& done : loading.waiting) done(error ? nullptr : &loaded, error);
}

std::vector<std::shared_ptr<const transport::World>> SceneRegistry::keep(
    const LoadedScene& loaded, const v1::CreateSceneRequest& source) {
  Entry& entry = scenes_[loaded.id];
  std::vector<std::shared_ptr<const transport::World>> released;
  if (entry.world) {
    released.push_back(entry.world);
  }
  const bool known = !entry.description.name().empty();
  const google::protobuf::Timestamp create_time = entry.description.create_time();
  entry.description = loaded.description;
  if (known) *entry.description.mutable_create_time() = create_time;
  entry.source = source;
  entry.world = loaded.world;
  entry.last_use = ++use_counter_;
  if (source.has_manifest()) id_by_source_[source_key(source)] = loaded.id;

  int64_t total = 0;
  for (const auto& [id, other] : scenes_) {
    if (other.world) total += other.description.statistics().memory_bytes();
  }
  while (total > memory_budget_bytes_) {
    Entry* oldest = nullptr;
    for (auto& [id, other] : scenes_) {
      if (other.world && id != loaded.id && (oldest == nullptr || other.last_use < oldest->last_use))
        oldest = &other;
    }
    if (oldest == nullptr) break;
    total -= oldest->description.statistics().memory_bytes();
    released.push_back(std::move(oldest->world));
    oldest->world = nullptr;
  }
  return released;
}

void SceneRegistry::shut_down() {
  std::vector<std::function<void(const LoadedScene*, std::exception_ptr)>> waiting;
  {
    const std::lock_guard lock(mutex_);
    shut_down_ = true;
    for (auto& [key, loading] : loading_) {
      std::ranges::move(loading.waiting, std::back_inserter(waiting));
      loading.waiting.clear();
    }
  }
  for (const auto& done : waiting) done(nullptr, std::make_exception_ptr(shutting_down()));
}

v1::Scene SceneRegistry::get(const std::string& id) const {
  const std::lock_guard lock(mutex_);
  const auto found = scenes_.find(id);
  if (found == scenes_.end()) throw not_found(id);
  return describe(found->second);
}

void SceneRegistry::remove(const std::string& id) {
  std::shared_ptr<const transport::World> released;
  {
    const std::lock_guard lock(mutex_);
    const auto found = scenes_.find(id);
    if (found == scenes_.end()) throw not_found(id);
    // scene.json first: without it the folder counts as absent, whatever interrupts the rest.
    FOGBANK_FAILPOINT("scene.before_remove");
    const fs::path folder = settings_.folder / id;
    if (::unlink((folder / "scene.json").c_str()) != 0 && errno != ENOENT)
      throw_file_error(errno, "removing", folder / "scene.json");
    sync_folder(folder);
    FOGBANK_FAILPOINT("scene.after_remove");
    released = found->second.world;
    scenes_.erase(found);
    std::erase_if(id_by_source_, [&](const auto& item) { return item.second == id; });
    std::error_code ignored;
    fs::remove_all(folder, ignored);
  }
}

v1::ListScenesResponse SceneRegistry::list(int page_size, const std::string& page_token) const {
  const auto wanted = static_cast<size_t>(effective_page_size(page_size));
  std::vector<v1::Scene> scenes;
  {
    const std::lock_guard lock(mutex_);
    for (const auto& [id, entry] : scenes_) scenes.push_back(describe(entry));
  }
  std::ranges::sort(scenes, std::ranges::greater{}, page_key);
  const bool token_valid = page_token.empty() || page_token.find(" scenes/") != std::string::npos;
  if (!token_valid) {
    throw RpcError(StatusCode::INVALID_ARGUMENT, "INVALID_PAGE_TOKEN",
                   "page_token is not one of this server's", {{"field", "page_token"}});
  }
  v1::ListScenesResponse response;
  for (const v1::Scene& scene : scenes) {
    if (!page_token.empty() && page_key(scene) >= page_token) continue;
    if (static_cast<size_t>(response.scenes_size()) == wanted) {
      response.set_next_page_token(page_key(response.scenes(response.scenes_size() - 1)));
      break;
    }
    *response.add_scenes() = scene;
  }
  return response;
}

std::set<std::string> SceneRegistry::blobs_in_use() const {
  std::set<std::string> blobs;
  auto add = [&](const v1::CreateSceneRequest& source) {
    for (const v1::ManifestEntry& entry : source.manifest().entries()) blobs.insert(entry.sha256());
  };
  const std::lock_guard lock(mutex_);
  for (const auto& [id, entry] : scenes_) add(entry.source);
  for (const auto& [key, loading] : loading_) add(loading.source);
  return blobs;
}

SceneRegistry::Counts SceneRegistry::counts() const {
  const std::lock_guard lock(mutex_);
  Counts counts;
  for (const auto& [id, entry] : scenes_) {
    ++counts.scenes;
    if (!entry.world) continue;
    ++counts.resident;
    counts.resident_bytes += entry.description.statistics().memory_bytes();
  }
  return counts;
}

void SceneRegistry::set_memory_budget(int64_t bytes) {
  const std::lock_guard lock(mutex_);
  memory_budget_bytes_ = bytes;
}

}  // namespace fogbank::service
