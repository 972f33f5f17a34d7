// A job out of a checkpoint, and the other way round.
#include <algorithm>

#include "core/error.h"
#include "render/render_job_state.h"

namespace fogbank::render {

namespace {

[[noreturn]] void refuse(const char* why) {
  throw Error(ErrorKind::data_loss, "CHECKPOINT_DAMAGED",
              std::string("the checkpoint can't be used: ") + why);
}

/// The progression of a job that has nothing to prepare, asked again what it was asked before. It decides by
/// samples alone as long as it goes on, so it stands as it stood then. With a time budget passes depended on
/// the clock; there, only the beginning is repeated.
Progression replay(const RenderSettings& settings, uint32_t most_samples, const Checkpoint& checkpoint) {
  Progression progression(settings, most_samples);
  Standing standing;
  uint32_t passes = 0;
  while (standing.samples < checkpoint.samples) {
    const Step step = progression.next(standing);
    if (step.kind == Step::Kind::prepare) {
      progression.nothing_to_prepare();
    } else if (step.kind == Step::Kind::finish) {
      refuse("it has more samples than the job");
    } else if (settings.time_budget_seconds > 0) {
      return progression;
    } else {
      standing.samples += step.samples;
      ++passes;
      const auto judged = std::ranges::find(checkpoint.history, standing.samples, &HistoryEntry::samples);
      standing.disagreement = judged != checkpoint.history.end() ? judged->estimate.disagreement : 0;
    }
  }
  if (standing.samples != checkpoint.samples || passes != checkpoint.passes)
    refuse("its passes are not the job's");
  return progression;
}

}  // namespace

std::optional<Checkpoint> RenderJob::checkpoint() const {
  const Implementation& job = *implementation_;
  const std::lock_guard lock(job.mutex);
  if (job.films.passes_done() == 0 || job.layered || job.cancelled) return std::nullopt;
  Checkpoint checkpoint;
  checkpoint.passes = job.films.passes_done();
  checkpoint.samples = job.films.samples_done();
  checkpoint.tiles = job.films.finished();
  checkpoint.rays = job.rays;
  checkpoint.invalid_samples = job.invalid_samples;
  checkpoint.render_seconds = job.elapsed_seconds();
  checkpoint.cpu_seconds = job.cpu_seconds;
  // Whether the last pass has been judged by now is a matter of chance: it will be judged again.
  std::ranges::copy_if(job.history, std::back_inserter(checkpoint.history),
                       [&](const HistoryEntry& entry) { return entry.samples < checkpoint.samples; });
  return checkpoint;
}

void RenderJob::resume(const Checkpoint& checkpoint) {
  Implementation& job = *implementation_;
  if (checkpoint.passes == 0 || checkpoint.tiles.size() != job.films.grid().count())
    refuse("its tiles are not the job's");
  for (uint32_t index = 0; index < checkpoint.tiles.size(); ++index) {
    const scene::Window window = job.films.grid().window(index);
    const size_t pixels = static_cast<size_t>(window.width) * static_cast<size_t>(window.height);
    const TileFilm& tile = *checkpoint.tiles[index];
    if (tile.sampled.size() != pixels || tile.narrow.size() != (job.film_layers().narrow ? pixels : 0)) {
      refuse("its tiles are not the job's");
    }
  }
  Progression progression = replay(job.settings, job.integrator->most_samples_of_pass(), checkpoint);

  const std::lock_guard lock(job.mutex);
  if (job.start || job.running > 0)
    throw Error(ErrorKind::failed_precondition, "JOB_STARTED", "a job is resumed before its first task");
  job.progression = std::move(progression);
  job.films.resume(checkpoint.passes, checkpoint.samples, checkpoint.tiles);
  job.rays = checkpoint.rays;
  job.invalid_samples = checkpoint.invalid_samples;
  job.cpu_seconds = checkpoint.cpu_seconds;
  job.history = checkpoint.history;
  job.activity = Implementation::Activity::pass;
  job.start = Implementation::Clock::now() - std::chrono::duration_cast<Implementation::Clock::duration>(
                                                 std::chrono::duration<double>(checkpoint.render_seconds));
}

}  // namespace fogbank::render
