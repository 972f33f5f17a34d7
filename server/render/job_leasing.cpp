// The part of a job that lets replicas perform its tasks.
#include <utility>

#include "render/render_job_state.h"

namespace fogbank::render {

RenderJob::Stage RenderJob::stage() const {
  const Implementation& job = *implementation_;
  const std::lock_guard lock(job.mutex);
  Stage stage{.number = job.stage, .tasks = 0, .log_length = job.log->length()};
  if (job.phase == Implementation::Phase::rendering) {
    stage.tasks = job.films.grid().count();
  } else if (job.phase != Implementation::Phase::planning) {
    stage.tasks = job.rounds.count();
  }
  return stage;
}

std::optional<LeasedTask> RenderJob::lease() {
  Implementation& job = *implementation_;
  std::optional<Task> task;
  uint32_t stage = 0;
  {
    const std::lock_guard lock(job.mutex);
    job.watch_time();
    if (job.phase == Implementation::Phase::planning) return std::nullopt;
    if (job.own.keeps(Implementation::Clock::now())) return std::nullopt;
    task = job.take();
    if (!task) return std::nullopt;
    stage = job.stage;
    ++job.running;  // nothing is planned while the task is described
  }
  LeasedTask leased = job.describe(*task, stage);
  const std::lock_guard lock(job.mutex);
  --job.running;
  return leased;
}

void RenderJob::set_trip_seconds(double seconds) {
  const std::lock_guard lock(implementation_->mutex);
  implementation_->own.set_trip_seconds(seconds, Implementation::Clock::now());
}

bool RenderJob::caller_due() const {
  const Implementation& job = *implementation_;
  const std::lock_guard lock(job.mutex);
  if (job.ended()) return false;
  if (job.phase != Implementation::Phase::planning) return job.own.keeps(Implementation::Clock::now());
  return !job.plan_taken && job.running == 0;
}

std::chrono::steady_clock::time_point RenderJob::callers_until() const {
  const Implementation& job = *implementation_;
  const std::lock_guard lock(job.mutex);
  return job.phase == Implementation::Phase::planning ? Implementation::Clock::time_point{}
                                                      : job.own.kept_until();
}

void RenderJob::Implementation::share_stage() {
  // Rounds of preparations have the numbers below.
  constexpr uint32_t survey_kind = 16;
  constexpr uint32_t aov_kind = 17;
  constexpr uint32_t tile_kind = 18;
  const Clock::time_point now = Clock::now();
  if (phase == Phase::preparing) {
    own.begin_stage(preparation->round_kind(), rounds.count(), now);
  } else if (phase == Phase::surveying) {
    own.begin_stage(activity == Activity::aovs ? aov_kind : survey_kind, rounds.count(), now);
  } else if (integrator->prepares_passes()) {
    own.begin_leased_stage();  // only replicas have what these passes need
  } else {
    own.begin_stage(tile_kind, static_cast<double>(crop_pixels) * pass_samples, now);
  }
}

LeasedTask RenderJob::Implementation::describe(const Task& task, uint32_t its_stage) const {
  LeasedTask leased{.stage = its_stage, .index = 0, .kind = LeasedKind::tile, .input = {}};
  TaskInput input{.step = log->steps(), .what = {}};
  if (const auto* const preparing = std::get_if<PreparationTask>(&task)) {
    leased.kind = LeasedKind::preparation;
    leased.index = preparing->index;
    input.what = PreparationInput{.task = preparing->index};
  } else if (const auto* const surveying = std::get_if<SurveyTask>(&task)) {
    leased.kind = LeasedKind::survey;
    leased.index = surveying->index;
    input.what =
        SurveyInput{.stride = survey.stride(), .channels = survey.channels(), .row = surveying->index};
  } else {
    const auto& tile = std::get<TileTask>(task);
    TileFilmPointer before;
    {
      const std::lock_guard lock(mutex);
      before = films.current(tile.tile);
    }
    leased.index = tile.tile;
    input.what = TileInput{.task = tile, .film = film_for(tile, film_layers(), before.get())};
  }
  leased.input = bytes_of(input);
  return leased;
}

void RenderJob::recall_leases() {
  Implementation& job = *implementation_;
  const std::lock_guard lock(job.mutex);
  if (job.phase == Implementation::Phase::rendering) {
    job.films.recall();
  } else {
    job.rounds.recall();
  }
}

const JobLog& RenderJob::log() const { return *implementation_->log; }

Completion RenderJob::complete(uint32_t stage, uint32_t index, const TaskResult& result) {
  Implementation& job = *implementation_;
  Implementation::Phase phase{};
  {
    const std::lock_guard lock(job.mutex);
    job.watch_time();  // what comes too late doesn't count
    if (job.ended() || stage != job.stage) return Completion::ignored;
    phase = job.phase;
  }
  switch (phase) {
    case Implementation::Phase::planning:
      break;
    case Implementation::Phase::preparing:
      return job.complete_round_task(stage, index, result,
                                     [&] { job.preparation->accept(index, result.bytes); });
    case Implementation::Phase::surveying:
      return job.complete_round_task(stage, index, result,
                                     [&] { job.survey.set_row(index, job.survey.row_values(result.bytes)); });
    case Implementation::Phase::rendering:
      return job.complete_tile(stage, index, result);
  }
  return Completion::ignored;
}

void RenderJob::Implementation::account(const TaskResult& result, double work) {
  rays += result.rays;
  invalid_samples += result.invalid_samples;
  cpu_seconds += result.cpu_seconds;
  own.learn(work, result.cpu_seconds, Clock::now());
}

template <typename Work>
Completion RenderJob::Implementation::complete_round_task(uint32_t its_stage, uint32_t index,
                                                          const TaskResult& result, const Work& work) {
  RoundTask task;
  {
    const std::lock_guard lock(mutex);
    task = {rounds.round(), index};
    if (stage != its_stage || !rounds.begin(task)) return Completion::ignored;
    ++running;
  }
  const auto end_this = [&](bool done) {
    const std::lock_guard lock(mutex);
    --running;
    if (done) account(result, 1);
    watch_time();
    if (stage == its_stage && rounds.end(task, done, true)) phase = Phase::planning;
  };
  try {
    work();
  } catch (...) {
    end_this(false);
    throw;
  }
  end_this(true);
  return Completion::round_task;
}

Completion RenderJob::Implementation::complete_tile(uint32_t its_stage, uint32_t index,
                                                    const TaskResult& result) {
  TileTask task;
  FilmLayers layers;
  {
    const std::lock_guard lock(mutex);
    if (stage != its_stage || index >= films.grid().count()) return Completion::ignored;
    task = films.task(index);
    if (films.is_done(task)) return Completion::ignored;
    layers = film_layers();
  }
  auto film = std::make_shared<const TileFilm>(film_after(task, layers, result.bytes));
  TileFilmPointer outdated;  // outlives the lock, so that its memory isn't freed under it
  const std::lock_guard lock(mutex);
  watch_time();  // what comes too late doesn't count
  if (stage != its_stage || films.is_done(task)) return Completion::ignored;
  account(result, pixel_samples(task));
  if (!films.add(task, std::move(film), outdated)) return Completion::tile;
  end_pass();
  return Completion::last_tile;
}

}  // namespace fogbank::render
