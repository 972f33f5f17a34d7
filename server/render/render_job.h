// A progressive rendering as a set of tasks. The caller (the service's scheduler, a test, a farm worker) owns
// the threads: it asks for the next task, runs it on any thread, and reads the film. The image depends on
// scene, settings, the cache's records at the start and the number of finished samples per pixel only: sample
// i of film pixel (x, y) draws from RandomStream(seed, x, y, i), and the samples of a pixel are summed in the
// order of i, however they are split into passes and tiles. Where a time budget decides what is done, it
// depends on that, too.
#pragma once

#include <atomic>
#include <chrono>
#include <cstdint>
#include <memory>
#include <optional>
#include <vector>

#include "integrators/integrator.h"
#include "render/checkpoint.h"
#include "render/image.h"
#include "render/job_log.h"
#include "render/leased_task.h"
#include "render/progress.h"
#include "render/render_settings.h"
#include "render/task.h"

namespace fogbank::transport {
class World;
}

namespace fogbank::render {

/// Who performs a job's tasks.
enum class Performers : uint8_t {
  caller,    ///< by `next_task` and `run`
  replicas,  ///< of the job (replica.h), by `lease` and `complete`; the caller runs what falls to it
};

/// What became of a result.
enum class Completion : uint8_t {
  ignored,     ///< the task is done, or no longer wanted
  round_task,  ///< accepted, of a preparation or a survey
  tile,        ///< accepted
  last_tile,   ///< accepted, which completed a pass
};

class RenderJob {
 public:
  /// Throws like `validate` and `make_integrator`. Image and records are the same whoever performs the tasks;
  /// but a job whose tasks replicas perform sees the cache as it is now, whatever other jobs add meanwhile.
  RenderJob(std::shared_ptr<const transport::World> world, const RenderSettings& settings,
            Performers performers = Performers::caller);
  /// With an integrator that is made already; `settings.integrator` is only a name then.
  RenderJob(std::unique_ptr<integrators::Integrator> integrator, RenderSettings settings);
  ~RenderJob();

  const RenderSettings& settings() const;

  /// Next task to run, or nullopt when there is none now: all are handed out (a round or pass begins only
  /// when the one before is complete, so that every finished pass is a whole image), or the job is finished
  /// or cancelled. `ended` tells these apart; note that a time budget can end the job right here. Whenever
  /// `run` returns there may be new tasks. Thread-safe.
  std::optional<Task> next_task();
  /// Runs a task; returns true when that completed a pass. Nothing has changed, and the result is false, when
  /// `stop` is set meanwhile (the task is handed out again later), when the job is cancelled or out of time,
  /// and when the task is done already. An exception of the integrator leaves the film unchanged, too.
  /// Thread-safe. Leaves the thread prepared for rendering (`scene::prepare_render_thread`).
  bool run(const Task& task, const std::atomic<bool>& stop);
  /// No task is handed out afterwards, and those that run leave the film unchanged.
  void cancel();

  // Of a job whose tasks replicas perform (job_leasing.cpp). Thread-safe.

  /// What can be leased now. Tasks of an earlier stage are no longer wanted.
  struct Stage {
    uint32_t number = 0;      ///< grows
    uint32_t tasks = 0;       ///< of the stage, done ones included
    uint64_t log_length = 0;  ///< entries that a replica needs to perform them
  };
  Stage stage() const;
  /// A stage that would take one thread less than so many seconds is the caller's, by `next_task` and `run`:
  /// what it takes to bring a task to a replica and back. 0 (as at first): the caller runs plan tasks only.
  /// Counts from the next stage on; when it is said for the first time, for the present one, too.
  void set_trip_seconds(double seconds);
  /// A task that nobody has, if any; none while the stage is the caller's.
  std::optional<LeasedTask> lease();
  /// Whoever leased tasks has gone: those that aren't complete can be leased again.
  void recall_leases();
  /// Takes a result, in any order, any number of times; the first one counts. Throws Error(invalid_argument,
  /// "POISONED_RESULT") where it can't be one; the task stays leased then. There may be a plan task to run
  /// whenever this returns.
  Completion complete(uint32_t stage, uint32_t index, const TaskResult& result);
  const JobLog& log() const;
  /// Whether there is a plan task to be taken, or the stage is the caller's.
  bool caller_due() const;
  /// When that may be over without anybody's doing; long ago unless the stage is the caller's.
  std::chrono::steady_clock::time_point callers_until() const;

  /// Finished or cancelled?
  bool ended() const;

  Progress progress() const;
  uint32_t tile_count() const;
  /// Tile `index` (row by row, from the upper left), the unfinished pass included. When the job ends by its
  /// time budget or by `cancel`, tiles of an unfinished pass fall back to the last finished one, so that the
  /// tiles together always end as `image()`; `pass` goes down by one then. Never torn; waits for nothing.
  /// Throws Error(invalid_argument, "NO_SUCH_TILE").
  TilePixels tile(uint32_t index) const;
  Image image() const;
  /// As after the last finished pass, for `resume`. None before the first one; none of a leased job whose
  /// film has a cached layer, as replicas need its whole log. Its records lie in the cache: they are to be on
  /// the disk (SceneCache::save) before it is. Waits for nothing.
  std::optional<Checkpoint> checkpoint() const;
  /// Goes on from there, to the same image as without the interruption; before any task was taken. The
  /// checkpoint must be of a job with this scene and these settings, and the job's cache must hold the
  /// checkpoint's records and no others (SceneCache::fork); else Error: data_loss "CHECKPOINT_DAMAGED",
  /// invalid_argument "POISONED_RESULT", where that shows, and the job is of no use any more. Leaves the
  /// thread prepared for rendering.
  void resume(const Checkpoint& checkpoint);
  /// The job after each pass, oldest first; thinned out evenly where there were more than 256 of them.
  std::vector<HistoryEntry> history() const;

 private:
  struct Implementation;
  std::unique_ptr<Implementation> implementation_;
};

}  // namespace fogbank::render
