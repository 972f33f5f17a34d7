#include "render/render_job.h"

#include <cmath>
#include <utility>

#include "core/error.h"
#include "render/film.h"
#include "render/job_integrator.h"
#include "render/render_job_state.h"
#include "transport/world.h"

namespace fogbank::render {

namespace {

RenderSettings validated(RenderSettings settings) {
  validate(settings);
  if (settings.record_budget > 0) {
    int64_t& most = settings.integrator_settings.most_records;
    most = std::min(most, settings.record_budget);
  }
  return settings;
}

std::vector<float> mean_pixels(const TileFilm& film) {
  std::vector<float> rgb;
  rgb.reserve(film.sampled.size() * 3);
  for (size_t pixel = 0; pixel < film.sampled.size(); ++pixel) {
    const Vec3d mean = film.mean(pixel);
    for (int channel = 0; channel < 3; ++channel) rgb.push_back(to_pixel(mean[channel]));
  }
  return rgb;
}

}  // namespace

RenderJob::Implementation::Implementation(std::unique_ptr<integrators::Integrator> integrator_to_use,
                                          RenderSettings settings_to_use,
                                          std::shared_ptr<cache::SceneCache> records_to_use)
    : settings(validated(std::move(settings_to_use))),
      camera(settings.sensor, settings.film),
      crop_pixels(static_cast<uint64_t>(settings.film.crop.width) *
                  static_cast<uint64_t>(settings.film.crop.height)),
      records(std::move(records_to_use)),
      log(records ? std::make_unique<JobLog>() : nullptr),
      integrator(std::move(integrator_to_use)),
      progression(settings, integrator->most_samples_of_pass()),
      films(settings) {
  told.pass_count = progression.pass_count();
  if (settings.reference) comparison.emplace(settings.reference);
  if (log) log->add(StartStep{.records = *records->records()});
}

double RenderJob::Implementation::elapsed_seconds() const {
  if (!start) return 0;
  return std::chrono::duration<double>((ended() ? end : Clock::now()) - *start).count();
}

void RenderJob::Implementation::stop_all() {
  end = Clock::now();
  interrupted = true;
  unwanted = true;
  ++stage;
  films.drop_unfinished_pass();
  rounds.begin_round(0);
}

std::optional<Task> RenderJob::Implementation::take() {
  if (ended()) return std::nullopt;
  switch (phase) {
    case Phase::planning:
      if (plan_taken || running > 0) break;
      plan_taken = true;
      return PlanTask{};
    case Phase::preparing:
      if (const auto task = rounds.take()) return PreparationTask{*task};
      break;
    case Phase::surveying:
      if (const auto task = rounds.take()) return SurveyTask{*task};
      break;
    case Phase::rendering:
      return films.take();
  }
  return std::nullopt;
}

RenderJob::RenderJob(std::shared_ptr<const transport::World> world, const RenderSettings& settings,
                     Performers performers) {
  RenderSettings own = validated(settings);
  std::shared_ptr<cache::SceneCache> records;
  if (performers == Performers::replicas) {
    std::shared_ptr<cache::SceneCache>& cache = own.integrator_settings.cache;
    records = cache ? std::make_shared<cache::SceneCache>(cache) : std::make_shared<cache::SceneCache>();
    cache = records;
  }
  auto integrator = make_job_integrator(std::move(world), own);
  implementation_ =
      std::make_unique<Implementation>(std::move(integrator), std::move(own), std::move(records));
}

RenderJob::RenderJob(std::unique_ptr<integrators::Integrator> integrator, RenderSettings settings)
    : implementation_(std::make_unique<Implementation>(std::move(integrator), std::move(settings), nullptr)) {
}

RenderJob::~RenderJob() = default;

const RenderSettings& RenderJob::settings() const { return implementation_->settings; }

std::optional<Task> RenderJob::next_task() {
  Implementation& job = *implementation_;
  const std::lock_guard lock(job.mutex);
  job.watch_time();
  const bool leased = job.log && job.phase != Implementation::Phase::planning;
  if (leased && !job.own.keeps(Implementation::Clock::now())) return std::nullopt;
  return job.take();
}

bool RenderJob::run(const Task& task, const std::atomic<bool>& stop) {
  scene::prepare_render_thread();
  return std::visit([&](const auto& kind) { return implementation_->run_task(kind, stop); }, task);
}

void RenderJob::cancel() {
  Implementation& job = *implementation_;
  const std::lock_guard lock(job.mutex);
  if (job.ended()) return;
  job.stop_all();
  job.cancelled = true;
}

bool RenderJob::ended() const { return implementation_->interrupted; }

Progress RenderJob::progress() const {
  const std::lock_guard lock(implementation_->mutex);
  return implementation_->progress();
}

Progress RenderJob::Implementation::progress() const {
  Progress progress = told;
  progress.passes_done = films.passes_done();
  if (finished) progress.pass_count = progress.passes_done;
  progress.samples_per_pixel = films.samples_done();
  progress.tiles_done = films.tiles_done();
  progress.samples_done = films.pixel_samples_done();
  progress.samples_planned = static_cast<uint64_t>(settings.samples_per_pixel) * crop_pixels;
  progress.invalid_samples = invalid_samples;
  progress.rays = rays;
  progress.render_seconds = elapsed_seconds();
  progress.cpu_seconds = cpu_seconds;
  progress.preparing = phase == Phase::preparing && activity == Activity::preparation && !ended();
  progress.finished = finished;
  if (settings.error > 0 && told.estimate.error) {
    // Noise, which more samples are for, falls by their root.
    const double ratio = std::fmax(1.0, *told.estimate.error / settings.error);
    const double needed = static_cast<double>(progress.samples_done) * ratio * ratio;
    if (needed < static_cast<double>(progress.samples_planned)) {
      progress.samples_planned = static_cast<uint64_t>(needed);
    }
  }
  if (finished) {
    progress.samples_planned = progress.samples_done;
  } else if (settings.time_budget_seconds > 0 && progress.render_seconds > 0) {
    const double share = progress.render_seconds / settings.time_budget_seconds;
    const double extrapolated = static_cast<double>(progress.samples_done) / std::fmin(1.0, share);
    if (extrapolated < static_cast<double>(progress.samples_planned)) {
      progress.samples_planned = static_cast<uint64_t>(extrapolated);
    }
  }
  return progress;
}

uint32_t RenderJob::tile_count() const { return implementation_->films.grid().count(); }

TilePixels RenderJob::tile(uint32_t index) const {
  const Implementation& job = *implementation_;
  if (index >= job.films.grid().count()) {
    throw Error(ErrorKind::invalid_argument, "NO_SUCH_TILE", "there is no tile " + std::to_string(index));
  }
  TilePixels pixels;
  pixels.window = job.films.grid().window(index);
  TileFilmPointer film;
  {
    const std::lock_guard lock(job.mutex);
    film = job.films.current(index);
  }
  if (film) {
    pixels.pass = film->passes;
    pixels.samples = film->samples;
    pixels.rgb = mean_pixels(*film);
  } else {
    pixels.rgb.resize(static_cast<size_t>(pixels.window.width) * static_cast<size_t>(pixels.window.height) *
                      3);
  }
  return pixels;
}

Image RenderJob::image() const {
  const Implementation& job = *implementation_;
  std::vector<TileFilmPointer> films;
  std::vector<ImageChannel> aovs;
  {
    const std::lock_guard lock(job.mutex);
    films = job.films.finished();
    aovs = job.aovs;
  }
  Image image;
  image.window = job.settings.film.crop;
  image.full_width = job.settings.film.width;
  image.full_height = job.settings.film.height;
  image.aovs = std::move(aovs);
  image.rgb.resize(static_cast<size_t>(job.crop_pixels) * 3);
  image.variance.resize(image.rgb.size());
  for (uint32_t index = 0; index < films.size(); ++index) {
    if (!films[index]) continue;
    const TileFilm& film = *films[index];
    image.samples = film.samples;
    const scene::Window window = job.films.grid().window(index);
    size_t pixel = 0;
    for (int32_t y = window.y - image.window.y; y < window.y - image.window.y + window.height; ++y) {
      for (int32_t x = window.x - image.window.x; x < window.x - image.window.x + window.width;
           ++x, ++pixel) {
        const size_t first =
            (static_cast<size_t>(y) * static_cast<size_t>(image.window.width) + static_cast<size_t>(x)) * 3;
        const Vec3d mean = film.mean(pixel);
        const Vec3d error = film.standard_error(pixel);
        for (int channel = 0; channel < 3; ++channel) {
          image.rgb[first + static_cast<size_t>(channel)] = to_pixel(mean[channel]);
          image.variance[first + static_cast<size_t>(channel)] = to_pixel(error[channel] * error[channel]);
        }
      }
    }
  }
  return image;
}

std::vector<HistoryEntry> RenderJob::history() const {
  const std::lock_guard lock(implementation_->mutex);
  return implementation_->history;
}

}  // namespace fogbank::render
