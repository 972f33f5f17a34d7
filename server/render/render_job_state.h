// What a RenderJob consists of. One mutex, held for microseconds, guards what changes; what may take long
// runs without it: tasks of preparations and tiles, in parallel, and the plan task, which runs alone.
#pragma once

#include <chrono>
#include <mutex>

#include "core/ray_counters.h"
#include "render/film_camera.h"
#include "render/pass_films.h"
#include "render/preparation_rounds.h"
#include "render/progression.h"
#include "render/render_job.h"

namespace fogbank::render {

struct RenderJob::Implementation {
  using Clock = std::chrono::steady_clock;
  enum class Phase : uint8_t { planning, preparing, rendering };

  /// What a task did besides pixels.
  struct TaskCounters {
    RayCounters rays;
    uint64_t invalid_samples = 0;
    double cpu_begin = 0;
  };

  Implementation(std::unique_ptr<integrators::Integrator> integrator_to_use, RenderSettings settings_to_use);

  // These are called with `mutex` held.

  bool ended() const { return finished || cancelled; }
  double elapsed_seconds() const;
  void stop_all();
  void finish();
  /// Ends what can't go on for want of time.
  void watch_time();
  std::optional<Clock::time_point> pass_deadline() const;
  std::optional<Task> take();
  void end_task(const TaskCounters& counters);
  Progress progress() const;

  // These without it.

  bool run_task(const PlanTask& task, const std::atomic<bool>& stop);
  bool run_task(const PreparationTask& task, const std::atomic<bool>& stop);
  bool run_task(const TileTask& task, const std::atomic<bool>& stop);
  /// The next phase; nullopt at the end. While no other task runs.
  std::optional<Phase> plan();
  /// Of the present preparation; false when there is none left.
  bool begin_round();
  void end_stage();
  void judge_pass();
  bool render(const TileTask& task, const std::atomic<bool>& stop, std::optional<Clock::time_point> deadline,
              TileFilm& film, TaskCounters& counters) const;

  const RenderSettings settings;
  const FilmCamera camera;
  const uint64_t crop_pixels;

  // Changed by the plan task only, which runs alone.
  const std::unique_ptr<integrators::Integrator> integrator;
  std::unique_ptr<integrators::Preparation> preparation;
  Progression progression;
  bool layered = false;  ///< the integrator has something to prepare: there is a cached layer
  bool pass_to_judge = false;

  mutable std::mutex mutex;
  Phase phase = Phase::planning;
  bool plan_taken = false;
  uint32_t running = 0;  ///< tasks
  PassFilms films;
  PreparationRounds rounds;
  bool preparation_dropped = false;
  std::optional<Clock::time_point> preparation_deadline;
  Progress told;  ///< what the plan task finds out
  std::vector<HistoryEntry> history;
  uint64_t rays = 0;
  uint64_t invalid_samples = 0;
  double cpu_seconds = 0;
  std::optional<Clock::time_point> start;
  Clock::time_point end{};
  bool finished = false;
  bool cancelled = false;
  std::atomic<bool> interrupted = false;  ///< finished or cancelled, for running tasks to poll
  std::atomic<bool> unwanted = false;     ///< that, or the present preparation is dropped
};

}  // namespace fogbank::render
