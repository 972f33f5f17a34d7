// What a RenderJob consists of. One mutex, held for microseconds, guards what changes; what may take long
// runs without it: tasks of preparations, surveys and tiles, in parallel, and the plan task, which runs
// alone.
#pragma once

#include <chrono>
#include <mutex>

#include "cache/scene_cache.h"
#include "core/ray_counters.h"
#include "render/cache_survey.h"
#include "render/error_estimate.h"
#include "render/film_camera.h"
#include "render/job_log.h"
#include "render/own_share.h"
#include "render/pass_films.h"
#include "render/progression.h"
#include "render/render_job.h"
#include "render/task_rounds.h"

namespace fogbank::render {

struct RenderJob::Implementation {
  using Clock = std::chrono::steady_clock;
  enum class Phase : uint8_t { planning, preparing, surveying, rendering };
  /// What the plan task finds to be done.
  enum class Activity : uint8_t { none, preparation, survey, pass_preparation, pass, aovs };

  /// What a task did besides pixels.
  struct TaskCounters {
    RayCounters rays;
    uint64_t invalid_samples = 0;
    double cpu_begin = 0;
  };

  /// `records_to_use`: the integrator's, of a leased job; else null.
  Implementation(std::unique_ptr<integrators::Integrator> integrator_to_use, RenderSettings settings_to_use,
                 std::shared_ptr<cache::SceneCache> records_to_use);

  // These are called with `mutex` held.

  bool ended() const { return finished || cancelled; }
  FilmLayers film_layers() const { return {.cached = layered, .narrow = integrator->blurs()}; }
  double elapsed_seconds() const;
  void stop_all();
  /// Stops what can't go on for want of time: what is left is to be planned then.
  void watch_time();
  void drop_work();
  std::optional<Clock::time_point> pass_deadline() const;
  std::optional<Task> take();
  /// Of work that is done, in units of OwnShare; 0: it was interrupted or failed.
  void end_task(const TaskCounters& counters, double work);
  /// The last tile of a pass is done.
  void end_pass();
  /// Throws as `resume`.
  void resume_stage(const Checkpoint& checkpoint);
  Progress progress() const;

  // These without it.

  bool run_task(const PlanTask& task, const std::atomic<bool>& stop);
  bool run_task(const PreparationTask& task, const std::atomic<bool>& stop);
  bool run_task(const SurveyTask& task, const std::atomic<bool>& stop);
  bool run_task(const TileTask& task, const std::atomic<bool>& stop);
  template <typename Work>
  void run_of_round(const RoundTask& task, Phase its_phase, const std::atomic<bool>& stop, const Work& work);

  // These of a leased job (job_leasing.cpp).

  LeasedTask describe(const Task& task, uint32_t its_stage) const;
  template <typename Work>
  Completion complete_round_task(uint32_t its_stage, uint32_t index, const TaskResult& result,
                                 const Work& work);
  Completion complete_tile(uint32_t its_stage, uint32_t index, const TaskResult& result);
  /// Of so much work, in units of OwnShare; with `mutex` held.
  void account(const TaskResult& result, double work);
  /// A stage has been planned: whose it is; with `mutex` held, by the plan task.
  void share_stage();

  // These by the plan task (job_plan.cpp).

  /// The next phase; nullopt at the end.
  std::optional<Phase> plan();
  std::optional<Phase> begin_preparation(const Step& step);
  std::optional<Phase> go_on_preparing();
  Phase go_on_preparing_pass();
  void end_stage(bool dropped);
  Phase begin_survey(Activity what, CacheSurvey empty);
  CacheSurvey empty_bias_survey() const;
  /// What a checkpoint is to have of the stage that has ended; null where it can't be continued.
  std::shared_ptr<CachedStage> describe_stage() const;
  void judge_pass();
  Standing standing() const;

  const RenderSettings settings;
  const FilmCamera camera;
  const uint64_t crop_pixels;

  // Of a leased job.
  const std::shared_ptr<cache::SceneCache> records;  ///< the integrator's; what others add doesn't show
  const std::unique_ptr<JobLog> log;                 ///< null: the job isn't leased

  // Changed by the plan task only, which runs alone.
  const std::unique_ptr<integrators::Integrator> integrator;
  std::unique_ptr<integrators::Preparation> preparation;  ///< of a stage or a pass
  uint32_t pass_cached_samples = 0;
  uint32_t pass_samples = 0;  ///< of the pass that is prepared
  Progression progression;
  std::optional<ReferenceComparison> comparison;
  bool layered = false;              ///< the integrator has something to prepare: there is a cached layer
  double cached_share = 1;           ///< of samples, that should look at the cache (film.h)
  uint32_t cached_samples_done = 0;  ///< per pixel, of the present epoch
  CacheSurvey survey;                ///< that runs; rows are written by its tasks
  CacheSurvey bias_survey;           ///< of the last stage
  double stage_begin = 0;            ///< seconds since the job's begin
  double survey_begin = 0;

  mutable std::mutex mutex;
  Phase phase = Phase::planning;
  Activity activity = Activity::none;
  bool plan_taken = false;
  uint32_t running = 0;  ///< tasks
  uint32_t stage = 0;    ///< of a leased job: which tasks are wanted
  OwnShare own;          ///< of a leased job
  PassFilms films;
  TaskRounds rounds;
  bool time_over = false;
  double reserved_seconds = 0;  ///< of a time budget, for AOVs
  std::optional<Clock::time_point> preparation_deadline;
  bool preparation_dropped = false;
  Progress told;                                       ///< what the plan task finds out
  std::shared_ptr<const CachedStage> cached_stage;     ///< as the next pass sees it
  std::shared_ptr<const CachedStage> stage_of_pass;    ///< as the last finished pass saw it
  std::optional<Progression::State> progression_then;  ///< when that pass was finished
  std::vector<HistoryEntry> history;
  std::vector<ImageChannel> aovs;
  uint64_t rays = 0;
  uint64_t invalid_samples = 0;
  double cpu_seconds = 0;
  std::optional<Clock::time_point> start;
  Clock::time_point end{};
  bool finished = false;
  bool cancelled = false;
  std::atomic<bool> interrupted = false;  ///< finished or cancelled, for running tasks to poll
  std::atomic<bool> unwanted = false;     ///< that, or the present preparation or survey is dropped
};

}  // namespace fogbank::render
