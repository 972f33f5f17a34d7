// The plan task of a job: what happens between rounds and passes.
#include <algorithm>
#include <cmath>
#include <utility>

#include "render/render_job_state.h"

namespace fogbank::render {

namespace {

constexpr size_t most_history_entries = 256;
/// Pixels a side of the lattice that the bias is estimated from: their scatter is a tenth of the estimate or
/// so.
constexpr int32_t survey_side = 24;

/// Every second entry goes when there are too many; the newest one stays.
void add_to_history(std::vector<HistoryEntry>& history, const HistoryEntry& entry) {
  history.push_back(entry);
  if (history.size() <= most_history_entries) return;
  size_t kept = 0;
  for (size_t i = history.size() % 2 == 0 ? 1 : 0; i < history.size(); i += 2) history[kept++] = history[i];
  history.resize(kept);
}

int32_t survey_stride(const scene::Window& crop) {
  return std::max(1, (std::min(crop.width, crop.height) + survey_side - 1) / survey_side);
}

}  // namespace

Standing RenderJob::Implementation::standing() const {
  const std::lock_guard lock(mutex);
  return {.samples = films.samples_done(),
          .elapsed_seconds = elapsed_seconds(),
          .reserved_seconds = reserved_seconds,
          .records_new = told.records_new,
          .noise = told.estimate.noise,
          .bias = told.estimate.bias,
          .disagreement = told.estimate.disagreement,
          .cached_share = cached_share,
          .cached_samples = cached_samples_done,
          .bias_falls = integrator->blurs()};
}

std::optional<RenderJob::Implementation::Phase> RenderJob::Implementation::plan() {
  Activity before = Activity::none;
  bool out_of_time = false;
  bool dropped = false;
  {
    const std::lock_guard lock(mutex);
    before = std::exchange(activity, Activity::none);
    out_of_time = time_over;
    dropped = std::exchange(preparation_dropped, false) || (time_over && before == Activity::preparation);
  }
  switch (before) {
    case Activity::none:
      break;
    case Activity::preparation:
      if (!dropped) return go_on_preparing();
      end_stage(true);
      break;
    case Activity::survey:
      if (!out_of_time) bias_survey = std::move(survey);
      end_stage(false);
      break;
    case Activity::pass_preparation:
      if (!out_of_time) return go_on_preparing_pass();
      preparation = nullptr;
      break;
    case Activity::pass:
      judge_pass();
      break;
    case Activity::aovs: {
      const std::lock_guard lock(mutex);
      for (size_t i = 0; i < survey.channels().size(); ++i) {
        aovs.push_back({"cache." + name_of(survey.channels()[i]), survey.values(i)});
      }
      return std::nullopt;
    }
  }
  for (;;) {
    const Step step = out_of_time ? Step{} : progression.next(standing());
    switch (step.kind) {
      case Step::Kind::finish:
        if (settings.aovs.empty() || settings.fill_only) return std::nullopt;
        return begin_survey(Activity::aovs, CacheSurvey(settings.film.crop, 1, settings.aovs));
      case Step::Kind::pass:
        pass_samples = step.samples;
        pass_cached_samples = step.cached_samples;
        // Replicas prepare a pass each for itself: what they need is too much to be sent around.
        if (!log) {
          preparation = integrator->prepare_pass(
              camera, {.seed = settings.seed, .first = standing().samples, .count = step.samples});
        }
        return go_on_preparing_pass();
      case Step::Kind::prepare:
        preparation = integrator->prepare(camera, step.target);
        if (preparation) return begin_preparation(step);
        progression.nothing_to_prepare();
    }
  }
}

std::optional<RenderJob::Implementation::Phase> RenderJob::Implementation::begin_preparation(
    const Step& step) {
  layered = true;
  {
    const std::lock_guard lock(mutex);
    stage_begin = elapsed_seconds();
    ++told.stage;
    told.stage_error = step.target.error;
    told.decisions = integrator->decisions();
    told.preparation_fraction = 0;
    if (step.latest_end_seconds) {
      preparation_deadline = *start + std::chrono::duration_cast<Clock::duration>(
                                          std::chrono::duration<double>(*step.latest_end_seconds));
    }
  }
  if (log) log->add(BeginStep{.target = step.target});
  return go_on_preparing();
}

std::optional<RenderJob::Implementation::Phase> RenderJob::Implementation::go_on_preparing() {
  RoundStep of_log;
  if (log) of_log.outcome = preparation->outcome();
  const uint32_t tasks = preparation->next_round();
  if (log) {
    of_log.next_tasks = tasks;
    of_log.records = records->records()->size();
    log->add(of_log);
  }
  const double fraction = tasks == 0 ? 1 : preparation->fraction();
  const integrators::CacheCounts counts = integrator->cache_counts();
  {
    const std::lock_guard lock(mutex);
    told.preparation_fraction = fraction;
    told.epoch = counts.epoch;
    told.records_reused = counts.records_reused;
    told.records_new = counts.records_new;
    if (tasks > 0) {
      activity = Activity::preparation;
      rounds.begin_round(tasks);
      return Phase::preparing;
    }
    preparation_deadline.reset();
    films.restart_cached();
    cached_share = 1;
    cached_samples_done = 0;
  }
  preparation = nullptr;
  if (settings.fill_only) return std::nullopt;
  return begin_survey(Activity::survey, empty_bias_survey());
}

RenderJob::Implementation::Phase RenderJob::Implementation::go_on_preparing_pass() {
  const uint32_t tasks = preparation ? preparation->next_round() : 0;
  if (tasks == 0) preparation = nullptr;
  const std::lock_guard lock(mutex);
  if (tasks > 0) {
    activity = Activity::pass_preparation;
    rounds.begin_round(tasks);
    return Phase::preparing;
  }
  activity = Activity::pass;
  films.begin_pass(pass_samples, pass_cached_samples);
  return Phase::rendering;
}

CacheSurvey RenderJob::Implementation::empty_bias_survey() const {
  return {settings.film.crop, survey_stride(settings.film.crop), {Aov::variance, Aov::bias}};
}

RenderJob::Implementation::Phase RenderJob::Implementation::begin_survey(Activity what, CacheSurvey empty) {
  survey = std::move(empty);
  const std::lock_guard lock(mutex);
  activity = what;
  unwanted = ended();
  survey_begin = elapsed_seconds();
  rounds.begin_round(survey.rows());
  return Phase::surveying;
}

void RenderJob::Implementation::end_stage(bool dropped) {
  if (log && preparation) {
    DropStep of_log{.outcome = preparation->outcome(), .records = 0};
    preparation = nullptr;
    of_log.records = records->records()->size();
    log->add(of_log);
  }
  preparation = nullptr;
  const integrators::CacheCounts counts = integrator->cache_counts();
  std::shared_ptr<CachedStage> described = describe_stage();
  const std::lock_guard lock(mutex);
  told.epoch = counts.epoch;
  told.records_new = counts.records_new;
  unwanted = ended();
  preparation_deadline.reset();
  const double now = elapsed_seconds();
  progression.stage_ended(now - stage_begin, dropped);
  if (!dropped && !settings.aovs.empty() && bias_survey.rows() > 0) {
    const double pixels = static_cast<double>(bias_survey.rows()) * bias_survey.columns();
    reserved_seconds = (now - survey_begin) * static_cast<double>(crop_pixels) / pixels;
  }
  if (described) described->reserved_seconds = reserved_seconds;
  cached_stage = std::move(described);
}

void RenderJob::Implementation::judge_pass() {
  std::vector<TileFilmPointer> finished_films;
  {
    const std::lock_guard lock(mutex);
    finished_films = films.finished();
  }
  std::vector<const TileFilm*> tiles;
  tiles.reserve(finished_films.size());
  for (const TileFilmPointer& film : finished_films) tiles.push_back(film.get());
  const PassImage image{films.grid(), tiles};

  ErrorEstimate estimate;
  // One sample of the cached layer tells nothing of that layer's noise.
  const TileFilm& any_tile = *tiles.front();
  if (any_tile.cached.empty() || any_tile.cached_samples.sum() > 1) {
    estimate.disagreement = relative_disagreement(tiles);
  }
  cached_share = any_tile.cached.empty() ? 1 : wanted_share_of_cached_samples(tiles);
  cached_samples_done = any_tile.cached_samples.sum();
  if (estimate.disagreement > 0) estimate.noise = progression.noise(estimate.disagreement, any_tile.samples);
  if (bias_survey.rows() > 0) estimate.bias = relative_bias(image, settings.film.crop, bias_survey);
  if (integrator->blurs()) estimate.bias = relative_blur(tiles);
  if (estimate.noise) estimate.error = std::hypot(*estimate.noise, estimate.bias);
  if (comparison) estimate.true_error = comparison->compare(image);

  const std::lock_guard lock(mutex);
  told.estimate = estimate;
  add_to_history(history, {.cpu_seconds = cpu_seconds,
                           .wall_seconds = elapsed_seconds(),
                           .samples = films.samples_done(),
                           .records = told.records_reused + told.records_new,
                           .epoch = told.epoch,
                           .estimate = estimate});
}

}  // namespace fogbank::render
