// A job out of a checkpoint, and the other way round.
#include <algorithm>
#include <span>

#include "cache/index.h"
#include "core/error.h"
#include "render/render_job_state.h"
#include "scene/intersector.h"

namespace fogbank::render {

namespace {

[[noreturn]] void refuse(const char* why) {
  throw Error(ErrorKind::data_loss, "CHECKPOINT_DAMAGED",
              std::string("the checkpoint can't be used: ") + why);
}

}  // namespace

std::optional<Checkpoint> RenderJob::checkpoint() const {
  const Implementation& job = *implementation_;
  const std::lock_guard lock(job.mutex);
  if (!job.progression_then || job.cancelled || (job.layered && !job.stage_of_pass)) return std::nullopt;
  Checkpoint checkpoint;
  checkpoint.progression = *job.progression_then;
  checkpoint.stage = job.stage_of_pass;
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

std::shared_ptr<CachedStage> RenderJob::Implementation::describe_stage() const {
  // Replicas follow a leased job by its log, which begins with the job.
  if (log) return nullptr;
  std::optional<std::string> state = integrator->state();
  const std::shared_ptr<const cache::Epoch> epoch = integrator->epoch();
  if (!state || !epoch) return nullptr;
  auto described = std::make_shared<CachedStage>();
  const std::span<const uint64_t> ids = epoch->records().ids();
  described->records.assign(ids.begin(), ids.end());
  described->integrator = std::move(*state);
  for (uint32_t row = 0; row < bias_survey.rows(); ++row)
    described->survey += CacheSurvey::bytes_of(bias_survey.row(row));
  return described;
}

void RenderJob::Implementation::resume_stage(const Checkpoint& checkpoint) {
  const CachedStage& then = *checkpoint.stage;
  CacheSurvey surveyed;
  if (!then.survey.empty()) {
    surveyed = empty_bias_survey();
    const size_t row_bytes = surveyed.channels().size() * surveyed.columns() * sizeof(float);
    if (then.survey.size() != surveyed.rows() * row_bytes) refuse("its survey is not the job's");
    for (uint32_t row = 0; row < surveyed.rows(); ++row)
      surveyed.set_row(row,
                       surveyed.row_values(std::string_view(then.survey).substr(row * row_bytes, row_bytes)));
  }
  integrator->restore(camera, then.integrator);
  const std::shared_ptr<const cache::Epoch> epoch = integrator->epoch();
  if (!epoch || !std::ranges::equal(epoch->records().ids(), then.records))
    refuse("its records are not the job's");

  const integrators::CacheCounts counts = integrator->cache_counts();
  layered = true;
  bias_survey = std::move(surveyed);
  cached_stage = checkpoint.stage;
  reserved_seconds = then.reserved_seconds;
  told.stage = checkpoint.progression.stages;
  told.stage_error = checkpoint.progression.stage_error;
  told.preparation_fraction = 1;
  told.decisions = integrator->decisions();
  told.epoch = counts.epoch;
  told.records_reused = counts.records_reused;
  told.records_new = counts.records_new;
}

void RenderJob::resume(const Checkpoint& checkpoint) {
  Implementation& job = *implementation_;
  if (checkpoint.passes == 0 || checkpoint.samples > static_cast<uint32_t>(job.settings.samples_per_pixel) ||
      checkpoint.tiles.size() != job.films.grid().count())
    refuse("its tiles are not the job's");
  const FilmLayers layers{.cached = checkpoint.stage != nullptr, .narrow = job.integrator->blurs()};
  for (uint32_t index = 0; index < checkpoint.tiles.size(); ++index) {
    const scene::Window window = job.films.grid().window(index);
    const size_t pixels = static_cast<size_t>(window.width) * static_cast<size_t>(window.height);
    const TileFilm& tile = *checkpoint.tiles[index];
    if (tile.sampled.size() != pixels || tile.narrow.size() != (layers.narrow ? pixels : 0) ||
        tile.cached.size() != (layers.cached ? pixels : 0) || tile.first_cached_sample > tile.samples) {
      refuse("its tiles are not the job's");
    }
  }

  scene::prepare_render_thread();
  const std::lock_guard lock(job.mutex);
  if (job.start || job.running > 0)
    throw Error(ErrorKind::failed_precondition, "JOB_STARTED", "a job is resumed before its first task");
  if (checkpoint.stage) job.resume_stage(checkpoint);
  job.progression.restore(checkpoint.progression);
  job.films.resume(checkpoint.passes, checkpoint.samples, checkpoint.tiles);
  job.end_pass();
  job.rays = checkpoint.rays;
  job.invalid_samples = checkpoint.invalid_samples;
  job.cpu_seconds = checkpoint.cpu_seconds;
  job.history = checkpoint.history;
  job.activity = Implementation::Activity::pass;
  job.start = Implementation::Clock::now() - std::chrono::duration_cast<Implementation::Clock::duration>(
                                                 std::chrono::duration<double>(checkpoint.render_seconds));
}

}  // namespace fogbank::render
