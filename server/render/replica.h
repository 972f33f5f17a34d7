// A replica of a leased job (RenderJob): performs the job's tasks in another process, and follows the job by
// its log. The caller owns the threads, as with RenderJob.
#pragma once

#include <atomic>
#include <condition_variable>
#include <cstdint>
#include <memory>
#include <mutex>
#include <optional>
#include <set>
#include <string>
#include <string_view>

#include "cache/scene_cache.h"
#include "core/ray_counters.h"
#include "render/cache_survey.h"
#include "render/film_camera.h"
#include "render/job_log.h"
#include "render/leased_task.h"
#include "render/task_rounds.h"

namespace fogbank::transport {
class World;
}

namespace fogbank::render {

/// Thread-safe.
class Replica {
 public:
  /// Of a job of `world` and `settings`; its cache and its reference image are not looked at. Throws like
  /// `validate` and `make_integrator`.
  Replica(std::shared_ptr<const transport::World> world, RenderSettings settings);
  ~Replica();
  Replica(const Replica&) = delete;
  Replica& operator=(const Replica&) = delete;

  /// Entries of the log that it has replayed.
  uint64_t log_length() const;
  /// Replays entry number `index`; nothing happens if it was replayed before. Tasks that the step has made
  /// useless are stopped first. Throws Error: failed_precondition "REPLICA_BEHIND" where entries are missing
  /// before; invalid_argument "INVALID_LOG" and "POISONED_RESULT"; internal "REPLICA_DIVERGED" where the
  /// replica doesn't come to what the log says. After the last two it is of no use any more. Leaves the
  /// thread prepared for rendering.
  void advance(uint64_t index, std::string_view entry);
  /// Performs a task: the result's bytes are a function of the job and the task alone. Nothing where the
  /// replica is past the task's stage. Throws Interrupted soon after `stop` was set; Error: invalid_argument
  /// "INVALID_TASK", failed_precondition "REPLICA_BEHIND"; and what the integrator throws. Leaves the thread
  /// prepared for rendering.
  std::optional<TaskResult> perform(const LeasedTask& task, const std::atomic<bool>& stop);

 private:
  void apply(const LogStep& step);
  void apply_step(const StartStep& step);
  void apply_step(const BeginStep& step);
  void apply_step(const RoundStep& step);
  void apply_step(const DropStep& step);
  void expect_records(uint64_t wanted) const;
  /// Waits until the task may run; false where it is outdated.
  bool enter(const LeasedTask& task, uint32_t step, const std::atomic<bool>& stop);
  void leave(const LeasedTask& task);
  TaskResult run(TaskInput& input, const std::atomic<bool>& stop);
  std::string run(const PreparationInput& input, RayCounters& counters, uint64_t& invalid_samples);
  std::string run(const SurveyInput& input, RayCounters& counters, uint64_t& invalid_samples);
  std::string run(TileInput& input, RayCounters& counters, uint64_t& invalid_samples);
  /// What Integrator::prepare_pass asks for, done by all threads that perform tiles of the pass.
  void prepare_pass(const integrators::PassSamples& samples, RayCounters& counters);
  void begin_pass_round();
  std::shared_ptr<const CacheSurvey> survey(const SurveyInput& input);

  const std::shared_ptr<const transport::World> world_;
  RenderSettings settings_;
  const FilmCamera camera_;

  std::mutex advancing_;  ///< one entry at a time; before `mutex_`
  JobLogReader reader_;
  std::shared_ptr<cache::SceneCache> cache_;

  // Changed while no task runs only.
  std::unique_ptr<integrators::Integrator> integrator_;  ///< from the first step on
  std::unique_ptr<integrators::Preparation> preparation_;
  uint32_t round_tasks_ = 0;

  mutable std::mutex mutex_;
  std::condition_variable changed_;
  uint64_t length_ = 0;
  uint32_t steps_ = 0;
  uint32_t stage_ = 0;
  std::set<uint32_t> running_;  ///< tasks of this stage, by index
  bool advancing_now_ = false;
  std::atomic<bool> unwanted_ = false;  ///< tasks that run are to stop

  // Of the present pass; with `mutex_` held, but for the rounds' tasks.
  std::optional<integrators::PassSamples> pass_;
  uint32_t pass_stage_ = 0;
  bool pass_ready_ = false;
  std::unique_ptr<integrators::Preparation> pass_preparation_;
  TaskRounds pass_rounds_;
  std::shared_ptr<const CacheSurvey> survey_;
};

}  // namespace fogbank::render
