// The scenes that the server knows, in memory for as long as there is room.
#pragma once

#include <cstdint>
#include <deque>
#include <exception>
#include <filesystem>
#include <functional>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <set>
#include <string>
#include <vector>

#include "fogbank/v1/scene.pb.h"
#include "service/scene_loading.h"
#include "service/scheduling/task_queue.h"

namespace fogbank::service {

/// A scene's description and the request that it came from are kept in `folder`/{id}, so that it survives a
/// restart; it is then loaded on first use. In memory, the least recently used scenes go when the rest is
/// above the budget; jobs keep theirs alive. Thread-safe; never blocks longer than a file takes to be
/// written.
class SceneRegistry {
 public:
  struct Settings {
    std::filesystem::path folder;
    std::optional<std::filesystem::path> scene_root;
  };

  /// Reads `folder`; what is damaged there is passed over with a log line.
  SceneRegistry(Settings settings, BlobStore& blobs, TaskQueue& loader, ReaderHost& readers);

  /// Memory of the scenes from the next one on, in bytes; none at first.
  void set_memory_budget(int64_t bytes);

  /// As `find_missing` (scene_loading.h).
  v1::PrepareSceneResponse prepare(const v1::SceneManifest& manifest) const {
    return find_missing(manifest, blobs_, readers_);
  }

  /// Either the scene or the error is set.
  using Created = std::function<void(const v1::Scene& scene, bool already_loaded, std::exception_ptr error)>;
  /// Answers in a thread of the loader, or at once. Requests for the same source share one loading.
  void create(const v1::CreateSceneRequest& request, Created done);

  /// A scene in memory, for a job. `load_seconds` is 0 when it was there already. Either world or error is
  /// set.
  using Acquired = std::function<void(std::shared_ptr<const transport::World> world, double load_seconds,
                                      std::exception_ptr error)>;
  /// Answers in a thread of the loader, or at once. Errors: RpcError SCENE_NOT_FOUND, SCENE_CHANGED (a server
  /// file is not what it was), TOO_MANY_LOADS, and as `load`.
  void acquire(const std::string& id, Acquired done);

  /// Throws RpcError SCENE_NOT_FOUND.
  v1::Scene get(const std::string& id) const;
  /// Throws RpcError SCENE_NOT_FOUND.
  void remove(const std::string& id);
  /// Throws RpcError INVALID_PAGE_SIZE, INVALID_PAGE_TOKEN.
  v1::ListScenesResponse list(int page_size, const std::string& page_token) const;

  /// Tells everybody who waits for a loading that the server ends, and loads nothing more.
  void shut_down();

  /// SHA-256 of every blob that a scene needs, those that are being loaded included.
  std::set<std::string> blobs_in_use() const;

  struct Counts {
    int scenes = 0;
    int resident = 0;
    int64_t resident_bytes = 0;
  };
  Counts counts() const;
  ReaderHost& readers() const { return readers_; }
  bool has_scene_root() const { return settings_.scene_root.has_value(); }

 private:
  struct Entry {
    v1::Scene description;
    v1::CreateSceneRequest source;
    std::shared_ptr<const transport::World> world;  ///< null while not resident
    uint64_t last_use = 0;
  };
  struct Loading {
    v1::CreateSceneRequest source;
    std::vector<std::function<void(const LoadedScene*, std::exception_ptr)>> waiting;
  };

  void restore();
  /// Starts or joins the loading of a source; with `mutex_` held. `expected_id` is set for a scene known
  /// before.
  void load_shared(const v1::CreateSceneRequest& source, const std::string& expected_id,
                   std::function<void(const LoadedScene*, std::exception_ptr)> done);
  void run_loading(const std::string& key, const std::string& expected_id);
  /// Keeps a loaded scene and makes room for it; returns what was pushed out, to be released without the
  /// lock.
  std::vector<std::shared_ptr<const transport::World>> keep(const LoadedScene& loaded,
                                                            const v1::CreateSceneRequest& source);
  v1::Scene describe(const Entry& entry) const;

  Settings settings_;
  BlobStore& blobs_;
  TaskQueue& loader_;
  ReaderHost& readers_;
  mutable std::mutex mutex_;
  int64_t memory_budget_bytes_ = 0;
  std::map<std::string, Entry> scenes_;
  std::map<std::string, std::string> id_by_source_;       ///< uploaded scenes, by the key of their source
  std::map<std::string, std::string> source_by_request_;  ///< request id -> key of its source
  std::deque<std::string> request_order_;                 ///< its keys, oldest first
  std::map<std::string, Loading> loading_;                ///< by the key of the source
  uint64_t use_counter_ = 0;
  bool shut_down_ = false;
};

}  // namespace fogbank::service
