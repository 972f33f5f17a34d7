// The tasks of a job, as one thread runs them.

#include <utility>

#include "core/error.h"
#include "core/thread_time.h"
#include "render/render_job_state.h"
#include "render/tile_samples.h"

namespace fogbank::render {

namespace {

std::chrono::steady_clock::duration clock_duration(double seconds) {
  return std::chrono::duration_cast<std::chrono::steady_clock::duration>(
      std::chrono::duration<double>(seconds));
}

}  // namespace

std::optional<RenderJob::Implementation::Clock::time_point> RenderJob::Implementation::pass_deadline() const {
  if (settings.time_budget_seconds == 0 || films.passes_done() == 0) return std::nullopt;
  return *start + clock_duration(settings.time_budget_seconds - reserved_seconds);
}

void RenderJob::Implementation::watch_time() {
  if (ended() || time_over) return;
  const Clock::time_point now = Clock::now();
  if (const auto deadline = pass_deadline(); deadline && now >= *deadline && activity != Activity::aovs) {
    time_over = true;
    if (phase != Phase::planning) drop_work();
  } else if (phase == Phase::preparing && preparation_deadline && now >= *preparation_deadline) {
    preparation_dropped = true;
    drop_work();
  }
}

void RenderJob::Implementation::drop_work() {
  // A finished pass that was not judged yet stays; an unfinished one has nothing to be judged.
  if (phase == Phase::rendering) activity = Activity::none;
  unwanted = true;
  films.drop_unfinished_pass();
  rounds.begin_round(0);
  phase = Phase::planning;
  ++stage;
}

void RenderJob::Implementation::end_task(const TaskCounters& counters, double work) {
  const double cpu = thread_cpu_seconds() - counters.cpu_begin;
  --running;
  rays += counters.rays.total();
  invalid_samples += counters.invalid_samples;
  cpu_seconds += cpu;
  if (log) own.learn(work, cpu, Clock::now());
}

void RenderJob::Implementation::end_pass() {
  phase = Phase::planning;
  // The plan task, which changes it, has not begun.
  progression_then = progression.state();
  stage_of_pass = cached_stage;
}

bool RenderJob::Implementation::run_task(const PlanTask&, const std::atomic<bool>& stop) {
  TaskCounters counters{.rays = {}, .invalid_samples = 0, .cpu_begin = thread_cpu_seconds()};
  {
    const std::lock_guard lock(mutex);
    plan_taken = false;
    if (ended() || phase != Phase::planning || running > 0 || stop) return false;
    if (!start) start = Clock::now();
    plan_taken = true;
    ++running;
  }
  try {
    const std::optional<Phase> next = plan();
    const std::lock_guard lock(mutex);
    end_task(counters, 0);
    plan_taken = false;
    if (ended()) return false;
    if (!next) {
      stop_all();
      finished = true;
      return false;
    }
    phase = *next;
    ++stage;
    if (log) share_stage();
    // The time may have run out while this was planned.
    if (time_over && activity != Activity::aovs) drop_work();
  } catch (...) {
    preparation = nullptr;
    const std::lock_guard lock(mutex);
    end_task(counters, 0);
    plan_taken = false;
    throw;
  }
  return false;
}

template <typename Work>
void RenderJob::Implementation::run_of_round(const RoundTask& task, Phase its_phase,
                                             const std::atomic<bool>& stop, const Work& work) {
  TaskCounters counters{.rays = {.stop = &stop, .unwanted = &unwanted},
                        .invalid_samples = 0,
                        .cpu_begin = thread_cpu_seconds()};
  {
    const std::lock_guard lock(mutex);
    if (ended() || phase != its_phase || !rounds.begin(task)) return;
    if (phase == Phase::preparing && preparation_deadline) counters.rays.deadline = *preparation_deadline;
    ++running;
  }
  const auto end_this = [&](bool done) {
    const std::lock_guard lock(mutex);
    end_task(counters, done ? 1 : 0);
    watch_time();
    // A round that was dropped meanwhile knows this task no longer.
    if (!ended() && phase == its_phase && rounds.end(task, done)) phase = Phase::planning;
  };
  try {
    counters.rays.poll();
    work(counters.rays);
    end_this(true);
  } catch (const Interrupted&) {
    end_this(false);
  } catch (...) {
    end_this(false);
    throw;
  }
}

bool RenderJob::Implementation::run_task(const PreparationTask& task, const std::atomic<bool>& stop) {
  run_of_round(task, Phase::preparing, stop,
               [&](RayCounters& counters) { preparation->run(task.index, counters); });
  return false;
}

bool RenderJob::Implementation::run_task(const SurveyTask& task, const std::atomic<bool>& stop) {
  run_of_round(task, Phase::surveying, stop, [&](RayCounters& counters) {
    survey.set_row(task.index, survey.look(task.index, *integrator, camera, settings.seed, counters));
  });
  return false;
}

bool RenderJob::Implementation::run_task(const TileTask& task, const std::atomic<bool>& stop) {
  TaskCounters counters{.rays = {.stop = &stop, .unwanted = &interrupted},
                        .invalid_samples = 0,
                        .cpu_begin = thread_cpu_seconds()};
  TileFilmPointer before;
  std::optional<Clock::time_point> deadline;
  {
    const std::lock_guard lock(mutex);
    if (!films.knows(task)) {
      throw Error(ErrorKind::invalid_argument, "NO_SUCH_TASK", "this job never handed out such a task");
    }
    if (ended() || films.is_done(task)) return false;
    before = films.current(task.tile);
    deadline = pass_deadline();
    ++running;
  }
  TileFilm film = film_for(task, film_layers(), before.get());
  bool complete = false;
  try {
    if (deadline) counters.rays.deadline = *deadline;
    counters.invalid_samples = add_samples(task, *integrator, camera, settings.seed, counters.rays, film);
    complete = true;
  } catch (const Interrupted&) {
    complete = false;
  } catch (...) {
    const std::lock_guard lock(mutex);
    end_task(counters, 0);
    if (!ended()) films.give_back(task.tile);
    throw;
  }

  auto made = std::make_shared<const TileFilm>(std::move(film));
  TileFilmPointer outdated;  // outlives the lock, so that its memory isn't freed under it
  const std::lock_guard lock(mutex);
  end_task(counters, complete ? pixel_samples(task) : 0);
  watch_time();  // what comes too late doesn't count
  // Run by two callers at once: both have the same pixels, and one has come first.
  if (ended() || films.is_done(task)) return false;
  if (!complete) {
    films.give_back(task.tile);
    return false;
  }
  if (!films.add(task, std::move(made), outdated)) return false;
  end_pass();
  return true;
}

}  // namespace fogbank::render
