// The plan task of a job: what happens between rounds and passes.
#include <algorithm>
#include <utility>

#include "render/render_job_state.h"

namespace fogbank::render {

namespace {

constexpr size_t most_history_entries = 256;

/// Every second entry goes when there are too many; the newest one stays.
void add_to_history(std::vector<HistoryEntry>& history, const HistoryEntry& entry) {
  history.push_back(entry);
  if (history.size() <= most_history_entries) return;
  size_t kept = 0;
  for (size_t i = history.size() % 2 == 0 ? 1 : 0; i < history.size(); i += 2) history[kept++] = history[i];
  history.resize(kept);
}

}  // namespace

bool RenderJob::Implementation::begin_round() {
  const uint32_t tasks = preparation->next_round();
  const double fraction = tasks == 0 ? 1 : preparation->fraction();
  const integrators::CacheCounts counts = integrator->cache_counts();
  const std::lock_guard lock(mutex);
  rounds.begin_round(tasks);
  told.preparation_fraction = fraction;
  told.epoch = counts.epoch;
  told.records_reused = counts.records_reused;
  told.records_new = counts.records_new;
  return tasks > 0;
}

void RenderJob::Implementation::end_stage() {
  const bool dropped = std::exchange(preparation_dropped, false);
  preparation = nullptr;
  const std::lock_guard lock(mutex);
  unwanted = false;
  preparation_deadline.reset();
  if (!dropped || films.passes_done() == 0) films.restart_cached();
}

void RenderJob::Implementation::judge_pass() {
  pass_to_judge = false;
  std::vector<TileFilmPointer> finished_films;
  {
    const std::lock_guard lock(mutex);
    finished_films = films.finished();
  }
  std::vector<const TileFilm*> tiles;
  tiles.reserve(finished_films.size());
  for (const TileFilmPointer& film : finished_films) tiles.push_back(film.get());
  ErrorEstimate estimate;
  if (const double noise = relative_noise(tiles); noise > 0) {
    estimate.noise = noise;
    estimate.error = noise;
  }
  const std::lock_guard lock(mutex);
  told.estimate = estimate;
  add_to_history(history, {.cpu_seconds = cpu_seconds,
                           .wall_seconds = elapsed_seconds(),
                           .samples = films.samples_done(),
                           .records = told.records_reused + told.records_new,
                           .epoch = told.epoch,
                           .estimate = estimate});
}

std::optional<RenderJob::Implementation::Phase> RenderJob::Implementation::plan() {
  if (pass_to_judge) judge_pass();
  if (preparation) {
    if (!preparation_dropped && begin_round()) return Phase::preparing;
    end_stage();
  }
  for (;;) {
    Standing standing;
    {
      const std::lock_guard lock(mutex);
      standing = {.samples = films.samples_done(), .elapsed_seconds = elapsed_seconds()};
    }
    const Step step = progression.next(standing);
    switch (step.kind) {
      case Step::Kind::finish:
        return std::nullopt;
      case Step::Kind::pass: {
        const std::lock_guard lock(mutex);
        films.begin_pass(step.samples);
        return Phase::rendering;
      }
      case Step::Kind::prepare:
        break;
    }
    preparation = integrator->prepare(camera, step.target);
    if (!preparation) {
      progression.nothing_to_prepare();
      continue;
    }
    layered = true;
    {
      const std::lock_guard lock(mutex);
      ++told.stage;
      told.stage_error = step.target.error;
      told.preparation_fraction = 0;
      if (step.latest_end_seconds) {
        preparation_deadline = *start + std::chrono::duration_cast<Clock::duration>(
                                            std::chrono::duration<double>(*step.latest_end_seconds));
      }
    }
    if (begin_round()) return Phase::preparing;
    end_stage();
  }
}

}  // namespace fogbank::render
