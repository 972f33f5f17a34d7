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

#include "fogbank/v1/farm.pb.h"
#include "fogbank/v1/render.pb.h"
#include "render/checkpoint.h"
#include "render/task.h"
#include "service/job_settings.h"
#include "service/job_store.h"
#include "service/rate_meter.h"
#include "service/rpc_error.h"
#include "service/scheduling/scheduler.h"
#include "service/scheduling/task_queue.h"
#include "service/scheduling/tile_board.h"
#include "service/scheduling/watch_cursor.h"
#include "service/task_limits.h"
#include "service/tile_source.h"
#include "service/work_trace.h"
#include "transport/world.h"

namespace fogbank::service {

class Job;

bool has_ended(v1::JobState state);

/// What a job needs of the server. `changed`, `ended` and `suspended` are called without any lock of the job
/// held.
struct JobServices {
  JobStore& store;
  std::filesystem::path folder;   ///< of {id}.exr and {id}.checkpoint
  TaskQueue& writer;              ///< encodes and stores images and checkpoints
  std::function<void()> changed;  ///< watchers may have something to see
  std::function<void(const std::shared_ptr<Job>&)> ended;
  std::function<void(const std::shared_ptr<Job>&)> suspended;
  /// Whether the scheduler is to ask a leased job for tasks may have changed (`active`).
  std::function<void(const std::shared_ptr<Job>&)> settle;
  /// CacheRegistry::keep_epoch.
  std::function<uint64_t(const scene::FieldIdentity&)> keep_epoch;
  int group = 0;  ///< of the scheduler: whose jobs these are
  TaskLimits task_limits;
  TraceLog* traces = nullptr;            ///< null: nothing is traced
  std::atomic<uint64_t> tiles = 0;       ///< rendered
  std::atomic<uint64_t> slow_tasks = 0;  ///< above TaskLimits::report_seconds, since the start
  std::atomic<int> lost_threads = 0;     ///< that render threads spend on jobs that were ended without them
};

/// Life: created queued; `start` gives it a scene; the scheduler takes its tasks; it ends exactly once, by
/// its last task, an error or `cancel`. What it acknowledges is in the store first. Now and then it writes a
/// checkpoint, from which `start` goes on in a later life of the server. Thread-safe.
class Job : public Workload, public std::enable_shared_from_this<Job> {
 public:
  /// A new job with these effective settings; `client` is the trace that its client belongs to.
  Job(const std::string& id, const v1::CreateJobRequest& request, const v1::RenderSettings& settings,
      JobServices& services, std::optional<TraceContext> client);
  /// A job of an earlier life of the server. Throws RpcError INVALID_NAME when the row makes no sense.
  Job(StoredJob stored, JobServices& services);

  const std::string& id() const { return id_; }
  const std::string& request_id() const { return request_.request_id(); }
  const std::string& request_hash() const { return request_hash_; }
  const std::string& scene_id() const { return scene_id_; }
  /// Effective.
  const v1::RenderSettings& settings() const { return settings_; }
  /// Most memory of its film, in bytes.
  int64_t film_bytes() const;
  /// Most bytes of its image's pixels, of variances and additional channels, too.
  int64_t image_bytes() const;

  /// The row of the store.
  StoredJob stored() const;
  /// What `start` needs: does its integrator use a cache, and as of which epoch; none: the newest.
  bool uses_cache() const;
  std::optional<uint64_t> epoch() const;
  /// It makes records and no picture.
  bool fill_only() const { return request_.fill_only(); }
  int32_t max_depth() const { return settings_.max_depth(); }
  /// Gives it its scene and the engine's settings, with the cache and the reference image if it uses any;
  /// tasks can be taken from now on. Goes on from a checkpoint if there is one. Nothing happens if it has
  /// ended.
  void start(const std::shared_ptr<const transport::World>& world, render::RenderSettings engine,
             double load_seconds);
  /// Ends it with an error, as soon as no task of it runs.
  void fail(const RpcError& error);
  /// As `fail`, but cancelled.
  void abandon(const RpcError& why);
  /// As `abandon`, and remembered before it returns. Throws as `JobStore::put`, and RpcError SHUTTING_DOWN.
  void cancel(const RpcError& why);
  /// Holds it, and lets it go on; remembered before they return. Nothing happens to one that has ended.
  /// Throw as `cancel`.
  void pause();
  void unpause();
  /// The server ends and the job does not: stops its tasks, writes a last checkpoint, sends its watchers
  /// away, and calls `suspended`, unless it is ending anyway.
  void suspend();

  /// Reports tasks that run long, and ends the job when one is above the limit: it fails with
  /// DEADLINE_EXCEEDED (TASK_STUCK), and doesn't wait for a task that goes on all the same.
  void watch_tasks(Clock::time_point now);
  /// What the spans of its watchers belong to; nullopt where nothing is traced.
  std::optional<TraceContext> trace_context() const;
  TraceLog* traces() const { return services_.traces; }

  v1::Job describe() const;
  v1::JobState state() const;
  bool ended() const;
  /// Has tasks, now or when others have returned.
  bool active() const;
  double rays_per_second() const;
  std::filesystem::path image_path() const { return services_.folder / (id_ + ".exr"); }
  std::filesystem::path checkpoint_path() const { return services_.folder / (id_ + ".checkpoint"); }

  // Of a leased job (job_leasing.cpp).
  bool leased() const { return request_.leased(); }
  /// Fills the answer with what there is now. Tasks go to one coordinator at a time. Throws RpcError
  /// JOB_NOT_LEASED.
  struct Leased {
    bool own = false;             ///< the job performs its present stage itself
    Clock::time_point own_until;  ///< at the latest
    bool outdated = false;        ///< tasks of the stage that the caller knows were leased, and it is over
  };
  Leased lease(const v1::LeaseTasksRequest& request, v1::LeaseTasksResponse& response);
  /// Takes a result; says in `response` what became of it. Throws RpcError LOG_CHANGED, JOB_NOT_LEASED.
  void complete(const std::string& log, const v1::TaskResultPart& last_part, std::string bytes,
                v1::CompleteTasksResponse& response);
  /// Entries from `first` on. Throws RpcError JOB_NOT_LEASED, JOB_NOT_RUNNING, LOG_CHANGED, INVALID_OFFSET.
  void read_log(const std::string& log, uint64_t first, v1::ReadJobLogResponse& response) const;

  // Workload
  std::function<void()> take() override;
  int max_threads() const override { return settings_.max_threads(); }
  int group() const override { return services_.group; }
  int urgency() const override { return static_cast<int>(priority_); }

  // Watching. While anybody watches, the job keeps what tiles are made of.
  void attach();
  void detach();
  struct NextEvent {
    std::optional<v1::WatchJobResponse> message;
    Clock::time_point retry_at;  ///< without a message: ask again then or at `changed`, whichever comes first
    bool last = false;
  };
  /// What to send next to the watcher with this cursor. Encodes a tile if it is one. Throws RpcError
  /// IMAGE_DAMAGED, and SHUTTING_DOWN of a job that is suspended.
  NextEvent next_event(WatchCursor& cursor);

 private:
  struct RunningTask {
    render::Task task;
    Clock::time_point start;
    bool reported = false;
    bool given_up = false;
  };

  void run(render::RenderJob& job, const render::Task& task, uint64_t number);
  /// Tasks that the job waits for; with `mutex_` held.
  bool has_running_tasks() const;
  /// Takes note of a task that returned, of a tile if it was one; with `mutex_` held.
  void account(std::optional<uint32_t> tile, bool pass_completed);
  void expect_leased() const;
  /// Of this life; with `mutex_` held.
  std::string log_id() const;
  /// Begins to end or to suspend the job if there is a reason and no task of it runs; with `mutex_` held.
  void finish_if_idle();
  void finish();
  void describe_result(v1::JobResult& result) const;
  void store_image(v1::JobResult& result);
  /// Keeps the epoch that a job without a picture has brought about.
  void keep_epoch(v1::JobResult& result);
  void end(v1::Job description);
  /// Can a later life of the server go on with it? Not with jobs that read what lies in memory only. Leased
  /// ones with a cache keep the first checkpoint: their replicas follow them from their beginning.
  bool keeps_checkpoints() const;
  /// Everything that a film depends on besides the number of its samples and the cache's records. From
  /// `start` on.
  std::string checkpoint_identity() const;
  /// The checkpoint of an earlier life, if there is one that can be read.
  std::optional<render::Checkpoint> read_checkpoint() const;
  /// The engine's job, from its checkpoint or from its beginning.
  std::shared_ptr<render::RenderJob> make_render_job(const std::shared_ptr<const transport::World>& world,
                                                     const render::RenderSettings& engine);
  /// Of a job with a cache, before any record of it is on the disk: which ones it begins with, so that it can
  /// begin with the same ones again.
  void write_first_checkpoint(cache::SceneCache& records);
  /// Has a checkpoint written when enough has been rendered since the last one; with `mutex_` held.
  void checkpoint_if_due();
  /// In the writer's thread.
  void write_checkpoint();
  void finish_suspension();
  /// Makes a change (true: there was one) with `mutex_` held, and stores the job; not if it has ended.
  void change_and_store(const std::function<bool()>& change);
  /// Publishes tiles again as cadence and cost allow; with `mutex_` held.
  void publish_tiles(Clock::time_point now);
  v1::Job describe_locked() const;
  v1::Progress describe_progress() const;
  std::shared_ptr<const TileSource> tile_source();
  /// The tile encoded, at least as new as its publication under `revision`; watchers share the encoding.
  std::shared_ptr<const v1::Tile> encoded_tile(uint32_t index, uint64_t revision);

  const std::string id_;
  const v1::CreateJobRequest request_;
  const std::string request_hash_;
  const std::string scene_id_;
  JobServices& services_;
  const v1::RenderSettings settings_;       ///< effective
  const v1::JobPriority priority_;          ///< never unspecified
  render::RenderSettings engine_settings_;  ///< changes with `start` only

  std::mutex store_mutex_;  ///< before `mutex_`: rows are stored in the order in which the job changes
  mutable std::mutex mutex_;
  v1::Job base_;  ///< everything but the progress of a running job
  TileBoard board_;
  std::shared_ptr<render::RenderJob> render_job_;
  std::weak_ptr<const TileSource> tile_source_;
  std::shared_ptr<const TileSource> kept_tile_source_;           ///< while somebody watches
  std::map<uint64_t, std::shared_ptr<const v1::Tile>> encoded_;  ///< by revision, while several watch
  size_t encoded_bytes_ = 0;
  std::string scene_fingerprint_;              ///< set once, by `start`
  std::optional<scene::FieldIdentity> field_;  ///< of its cache; none: it uses none
  std::atomic<bool> interrupt_ = false;        ///< for running tasks: it is stopped, paused or suspended
  bool stop_ = false;
  bool paused_ = false;
  bool suspended_ = false;
  std::optional<RpcError> failure_;  ///< why it is stopped
  bool failure_is_cancel_ = false;
  bool finishing_ = false;
  std::map<uint64_t, RunningTask> running_;  ///< by number
  uint64_t next_task_ = 0;
  WorkTrace trace_;
  int completing_ = 0;         ///< results of leased tasks that are being taken
  std::string coordinator_;    ///< that has the leased tasks
  uint32_t leased_stage_ = 0;  ///< of the last one that was leased
  uint64_t own_tasks_ = 0;     ///< of a leased job, performed here
  double own_cpu_seconds_ = 0;
  int watchers_ = 0;
  uint64_t tasks_completed_ = 0;
  std::vector<uint32_t> unfinished_pass_;  ///< tiles that the current pass has completed
  std::vector<uint32_t> doubtful_tiles_;   ///< tiles of which it isn't known, as their tasks were interrupted
  bool checkpoint_pending_ = false;
  uint32_t checkpoint_passes_ = 0;  ///< of the last checkpoint
  double checkpoint_seconds_ = 0;   ///< that all of them took, since the start
  double last_checkpoint_seconds_ = 0;
  double render_cpu_seconds_ = 0;
  double encode_cpu_seconds_ = 0;
  double load_seconds_ = 0;
  RateMeter ray_rate_;
};

}  // namespace fogbank::service
