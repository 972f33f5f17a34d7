// One render job: its state, its tasks for the scheduler, its events for watchers, its files.
#pragma once

#include <atomic>
#include <filesystem>
#include <functional>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <vector>

#include "fogbank/v1/render.pb.h"
#include "service/job_settings.h"
#include "service/rate_meter.h"
#include "service/rpc_error.h"
#include "service/scheduling/scheduler.h"
#include "service/scheduling/task_queue.h"
#include "service/scheduling/tile_board.h"
#include "service/scheduling/watch_cursor.h"
#include "service/tile_source.h"
#include "transport/world.h"

namespace fogbank::service {

class Job;

bool has_ended(v1::JobState state);

/// What a job needs of the server. `changed` and `ended` are called without any lock of the job held.
struct JobServices {
  TaskQueue& writer;              ///< encodes and stores final images
  std::function<void()> changed;  ///< watchers may have something to see
  std::function<void(const std::shared_ptr<Job>&)> ended;
};

/// Life: created queued; `start` gives it a scene; the scheduler takes its tasks; it ends exactly once, by
/// its last task, an error or `cancel`. What it acknowledges is in `folder` first: request.json, job.json,
/// image.exr. Thread-safe.
class Job : public Workload, public std::enable_shared_from_this<Job> {
 public:
  /// `settings.engine` lacks the cache, which `start` brings.
  Job(const std::string& id, const v1::CreateJobRequest& request, JobSettings settings,
      std::filesystem::path folder, JobServices& services);
  /// A job of an earlier life of the server. One that had not ended is now failed (SERVER_RESTARTED). Throws
  /// RpcError STORAGE_ERROR when the folder is damaged.
  static std::shared_ptr<Job> restore(std::filesystem::path folder, JobServices& services);

  const std::string& id() const { return id_; }
  const std::string& request_id() const { return request_id_; }
  const std::string& request_hash() const { return request_hash_; }
  const std::string& scene_id() const { return scene_id_; }
  /// Memory of its film while it runs, in bytes.
  int64_t film_bytes() const;

  /// Writes its folder. Throws as `write_file_durably`.
  void save(const v1::CreateJobRequest& request);
  /// What `start` needs: does its integrator use a cache, and as of which epoch; none: the newest.
  bool uses_cache() const;
  std::optional<uint64_t> epoch() const;
  int32_t max_depth() const { return settings_.max_depth(); }
  /// Gives it its scene and, if it uses one, the cache; tasks can be taken from now on. Nothing happens if it
  /// has ended.
  void start(std::shared_ptr<const transport::World> world, std::shared_ptr<cache::SceneCache> cache,
             double load_seconds);
  /// Ends it with an error, as soon as no task of it runs.
  void fail(const RpcError& error);
  /// As `fail`, but cancelled.
  void cancel(const RpcError& why);

  v1::Job describe() const;
  v1::JobState state() const;
  bool ended() const;
  double rays_per_second() const;
  std::filesystem::path image_path() const { return folder_ / "image.exr"; }
  const std::filesystem::path& folder() const { return folder_; }

  // Workload
  std::function<void()> take() override;
  int max_threads() const override { return settings_.max_threads(); }

  // Watching. While anybody watches, the job keeps what tiles are made of.
  void attach();
  void detach();
  struct NextEvent {
    std::optional<v1::WatchJobResponse> message;
    Clock::time_point retry_at;  ///< without a message: ask again then or at `changed`, whichever comes first
    bool last = false;
  };
  /// What to send next to the watcher with this cursor. Encodes a tile if it is one. Throws RpcError
  /// IMAGE_DAMAGED.
  NextEvent next_event(WatchCursor& cursor);

 private:
  struct Restored {};
  Job(Restored, const v1::CreateJobRequest& request, v1::Job description, std::filesystem::path folder,
      JobServices& services);

  void run(const render::Task& task);
  /// Begins to end the job if there is a reason and no task of it runs; with `mutex_` held.
  void finish_if_idle();
  void finish();
  void store_image(v1::Job& description);
  void end(v1::Job description);
  /// Publishes tiles again as cadence and cost allow; with `mutex_` held.
  void publish_tiles(Clock::time_point now);
  v1::Job describe_locked() const;
  v1::Progress describe_progress() const;
  std::shared_ptr<const TileSource> tile_source();
  /// The tile encoded, at least as new as its publication under `revision`; watchers share the encoding.
  std::shared_ptr<const v1::Tile> encoded_tile(uint32_t index, uint64_t revision);

  const std::string id_;
  const std::string request_id_;
  const std::string request_hash_;
  const std::string scene_id_;
  const std::filesystem::path folder_;
  JobServices& services_;
  const v1::RenderSettings settings_;       ///< effective
  render::RenderSettings engine_settings_;  ///< changes with `start` only

  mutable std::mutex mutex_;
  v1::Job base_;  ///< everything but the progress of a running job
  TileBoard board_;
  std::shared_ptr<render::RenderJob> render_job_;
  std::weak_ptr<const TileSource> tile_source_;
  std::shared_ptr<const TileSource> kept_tile_source_;           ///< while somebody watches
  std::map<uint64_t, std::shared_ptr<const v1::Tile>> encoded_;  ///< by revision, while several watch
  size_t encoded_bytes_ = 0;
  std::string scene_fingerprint_;
  std::string cache_name_;  ///< empty: it uses none
  std::atomic<bool> stop_ = false;
  std::optional<RpcError> failure_;  ///< why it is stopped
  bool failure_is_cancel_ = false;
  bool finishing_ = false;
  int running_tasks_ = 0;
  int watchers_ = 0;
  uint64_t tasks_completed_ = 0;
  std::vector<uint32_t> unfinished_pass_;  ///< tiles that the current pass has completed
  double render_cpu_seconds_ = 0;
  double encode_cpu_seconds_ = 0;
  double load_seconds_ = 0;
  RateMeter ray_rate_;
};

}  // namespace fogbank::service
