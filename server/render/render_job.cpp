#include "render/render_job.h"

#include <ctime>

#include <chrono>
#include <cmath>
#include <utility>

#include "core/error.h"
#include "core/random.h"
#include "render/film.h"
#include "render/passes.h"
#include "render/tiles.h"
#include "scene/intersector.h"
#include "transport/world.h"

namespace fogbank::render {

namespace {

using Clock = std::chrono::steady_clock;
using TileFilmPointer = std::shared_ptr<const TileFilm>;

double thread_cpu_seconds() {
  timespec now{};
  clock_gettime(CLOCK_THREAD_CPUTIME_ID, &now);
  return static_cast<double>(now.tv_sec) + 1e-9 * static_cast<double>(now.tv_nsec);
}

RenderSettings validated(RenderSettings settings) {
  validate(settings);
  return settings;
}

std::unique_ptr<const integrators::Integrator> make_checked_integrator(
    std::shared_ptr<const transport::World> world, const RenderSettings& settings) {
  validate(settings);
  const auto media = static_cast<int64_t>(world->scene().media.size());
  if (settings.sensor.medium < scene::none || settings.sensor.medium >= media) {
    throw Error(ErrorKind::invalid_argument, "INVALID_RENDER_SETTINGS",
                "sensor.medium: the scene has no medium " + std::to_string(settings.sensor.medium));
  }
  return integrators::make_integrator(settings.integrator, std::move(world), settings.integrator_settings);
}

std::vector<float> mean_pixels(const TileFilm& film) {
  std::vector<float> rgb;
  rgb.reserve(film.pixels.size() * 3);
  for (const PixelSums& pixel : film.pixels) {
    const Vec3d mean = pixel.mean(film.samples);
    for (int channel = 0; channel < 3; ++channel) rgb.push_back(to_pixel(mean[channel]));
  }
  return rgb;
}

}  // namespace

// A tile's film is an immutable object: a task makes the next one beside it and swaps it in. So what is read
// is never torn, readers wait for no renderer, and one mutex, held for nanoseconds, guards everything.
struct RenderJob::Implementation {
  struct Tile {
    TileFilmPointer current;   ///< null before the first pass
    TileFilmPointer finished;  ///< as after the last finished pass, kept while `current` is ahead of it
  };

  /// What a task did besides pixels.
  struct TaskCounters {
    RayCounters rays;
    uint64_t invalid_samples = 0;
    double cpu_seconds = 0;
  };

  Implementation(std::unique_ptr<const integrators::Integrator> integrator_to_use,
                 RenderSettings settings_to_use)
      : integrator(std::move(integrator_to_use)),
        settings(validated(std::move(settings_to_use))),
        grid(settings.film.crop, settings.tile_size),
        order(visiting_order(grid, settings.tile_order, settings.first_region)),
        crop_pixels(static_cast<uint64_t>(settings.film.crop.width) *
                    static_cast<uint64_t>(settings.film.crop.height)),
        tiles(grid.count()) {
    if (settings.time_budget_seconds == 0) pass_count = count_passes(samples_in_all(), tile_pixels());
    pass_samples = samples_of_next_pass(0, samples_in_all(), tile_pixels());
  }

  uint32_t samples_in_all() const { return static_cast<uint32_t>(settings.samples_per_pixel); }
  uint32_t tile_pixels() const { return static_cast<uint32_t>(settings.tile_size * settings.tile_size); }
  bool has_budget() const { return settings.time_budget_seconds > 0; }

  // The following are called with `mutex` held.

  bool ended() const { return finished || cancelled; }
  double elapsed_seconds() const {
    if (!start) return 0;
    return std::chrono::duration<double>((ended() ? end : Clock::now()) - *start).count();
  }
  void finish() {
    end = Clock::now();
    finished = true;
    interrupted = true;
    drop_unfinished_pass();
  }
  // The films of tiles that are ahead of the last finished pass are of no use any more.
  void drop_unfinished_pass() {
    for (Tile& tile : tiles) {
      if (tile.current && tile.current->passes > passes_done) tile.current = tile.finished;
      tile.finished = nullptr;
    }
    tiles_done = 0;
    pixels_done = 0;
    returned.clear();
    next_in_order = order.size();
  }
  void begin_next_pass() {
    tiles_done = 0;
    pixels_done = 0;
    returned.clear();
    next_in_order = 0;
    ++passes_done;
    samples_done += pass_samples;
    pass_samples = has_budget() ? samples_of_next_pass(samples_done, samples_in_all(), tile_pixels(),
                                                       elapsed_seconds(), settings.time_budget_seconds)
                                : samples_of_next_pass(samples_done, samples_in_all(), tile_pixels());
    if (pass_samples == 0) finish();
  }
  bool out_of_time() const {
    return has_budget() && passes_done > 0 && elapsed_seconds() >= settings.time_budget_seconds;
  }
  const TileFilmPointer& finished_film(const Tile& tile) const {
    return tile.current && tile.current->passes > passes_done ? tile.finished : tile.current;
  }

  // These are called without it.

  std::vector<TileFilmPointer> finished_films(uint32_t& passes) const {
    const std::lock_guard lock(mutex);
    std::vector<TileFilmPointer> films;
    films.reserve(tiles.size());
    for (const Tile& tile : tiles) films.push_back(finished_film(tile));
    passes = passes_done;
    return films;
  }
  bool render(const TileTask& task, const std::atomic<bool>& stop, std::optional<Clock::time_point> deadline,
              TileFilm& film, TaskCounters& counters) const;
  Spectrum sample(uint32_t x, uint32_t y, uint32_t index, TaskCounters& counters) const;

  const std::unique_ptr<const integrators::Integrator> integrator;
  const RenderSettings settings;
  const TileGrid grid;
  const std::vector<uint32_t> order;
  const uint64_t crop_pixels;
  uint32_t pass_count = 0;

  mutable std::mutex mutex;
  std::vector<Tile> tiles;
  uint32_t passes_done = 0;
  uint32_t samples_done = 0;  ///< per pixel, of finished passes
  uint32_t pass_samples = 0;  ///< of the current pass
  size_t next_in_order = 0;
  std::vector<uint32_t> returned;  ///< tiles of the current pass whose task was stopped
  uint32_t tiles_done = 0;         ///< of the current pass
  uint64_t pixels_done = 0;        ///< of the current pass
  uint64_t rays = 0;
  uint64_t invalid_samples = 0;
  double cpu_seconds = 0;
  std::optional<Clock::time_point> start;
  Clock::time_point end{};
  bool finished = false;
  bool cancelled = false;
  std::atomic<bool> interrupted = false;  ///< finished or cancelled, for running tasks to poll

  mutable std::mutex noise_mutex;
  mutable uint32_t noise_passes = 0;  ///< passes that `noise` was computed after
  mutable double noise = 0;
};

Spectrum RenderJob::Implementation::sample(uint32_t x, uint32_t y, uint32_t index,
                                           TaskCounters& counters) const {
  RandomStream random(settings.seed, x, y, index);
  const Vec2f offset = scene::sample_filter_offset(settings.film, random.next_vec2());
  const Vec2f position = Vec2f(static_cast<float>(x) + 0.5f, static_cast<float>(y) + 0.5f) + offset;
  const Ray ray = settings.sensor.sample_ray(settings.film, position, random.next_vec2());
  const integrators::PixelSample sample = integrator->sample(ray, random, counters.rays);
  const Spectrum radiance = sample.sampled + sample.cached;
  // A single NaN would stay in the pixel for ever. Black is wrong as well, hence the count, which isn't
  // hidden.
  if (is_finite(radiance) && min_component(radiance) >= 0) return radiance;
  ++counters.invalid_samples;
  return Spectrum(0);
}

bool RenderJob::Implementation::render(const TileTask& task, const std::atomic<bool>& stop,
                                       std::optional<Clock::time_point> deadline, TileFilm& film,
                                       TaskCounters& counters) const {
  // Each poll reads the clock, which takes about as long as 1 % of a sample.
  constexpr uint32_t samples_between_polls = 16;
  uint32_t until_poll = 0;
  const uint32_t end_sample = task.first_sample + task.sample_count;
  size_t pixel = 0;
  for (int32_t y = task.window.y; y < task.window.y + task.window.height; ++y) {
    for (int32_t x = task.window.x; x < task.window.x + task.window.width; ++x, ++pixel) {
      PixelSums& sums = film.pixels[pixel];
      for (uint32_t index = task.first_sample; index < end_sample; ++index) {
        if (until_poll-- == 0) {
          if (stop || interrupted || (deadline && Clock::now() >= *deadline)) return false;
          until_poll = samples_between_polls - 1;
        }
        sums.add(index, sample(static_cast<uint32_t>(x), static_cast<uint32_t>(y), index, counters));
      }
    }
  }
  film.passes = task.pass + 1;
  film.samples = end_sample;
  return true;
}

RenderJob::RenderJob(std::shared_ptr<const transport::World> world, const RenderSettings& settings)
    : RenderJob(make_checked_integrator(std::move(world), settings), settings) {}

RenderJob::RenderJob(std::unique_ptr<const integrators::Integrator> integrator, RenderSettings settings)
    : implementation_(std::make_unique<Implementation>(std::move(integrator), std::move(settings))) {}

RenderJob::~RenderJob() = default;

const RenderSettings& RenderJob::settings() const { return implementation_->settings; }

std::optional<TileTask> RenderJob::next_task() {
  Implementation& job = *implementation_;
  const std::lock_guard lock(job.mutex);
  if (job.ended()) return std::nullopt;
  if (job.out_of_time()) {
    job.finish();
    return std::nullopt;
  }
  uint32_t tile = 0;
  if (!job.returned.empty()) {
    tile = job.returned.back();
    job.returned.pop_back();
  } else if (job.next_in_order < job.order.size()) {
    tile = job.order[job.next_in_order++];
  } else {
    return std::nullopt;
  }
  return TileTask{tile, job.passes_done, job.grid.window(tile), job.samples_done, job.pass_samples};
}

bool RenderJob::run(const TileTask& task, const std::atomic<bool>& stop) {
  Implementation& job = *implementation_;
  scene::prepare_render_thread();

  TileFilmPointer before;
  std::optional<Clock::time_point> deadline;
  {
    const std::lock_guard lock(job.mutex);
    if (task.tile >= job.tiles.size() || task.pass > job.passes_done) {
      throw Error(ErrorKind::invalid_argument, "NO_SUCH_TASK", "this job never handed out such a task");
    }
    before = job.tiles[task.tile].current;
    if (job.ended() || (before && before->passes > task.pass)) return false;
    if (!job.start) job.start = Clock::now();
    if (job.has_budget() && job.passes_done > 0) {
      deadline = *job.start + std::chrono::duration_cast<Clock::duration>(
                                  std::chrono::duration<double>(job.settings.time_budget_seconds));
    }
  }
  TileFilm film;
  if (before) film = *before;
  film.pixels.resize(static_cast<size_t>(task.window.width) * static_cast<size_t>(task.window.height));

  const double cpu_begin = thread_cpu_seconds();
  Implementation::TaskCounters counters;
  const auto account = [&] {  // with the mutex held
    job.rays += counters.rays.total();
    job.invalid_samples += counters.invalid_samples;
    job.cpu_seconds += thread_cpu_seconds() - cpu_begin;
  };
  bool complete = false;
  try {
    complete = job.render(task, stop, deadline, film, counters);
  } catch (...) {
    const std::lock_guard lock(job.mutex);
    account();
    if (!job.ended()) job.returned.push_back(task.tile);
    throw;
  }

  auto made = std::make_shared<const TileFilm>(std::move(film));
  TileFilmPointer outdated;  // outlives the lock, so that its memory isn't freed under it
  const std::lock_guard lock(job.mutex);
  account();
  if (job.ended()) return false;
  if (job.out_of_time()) {
    job.finish();
    return false;
  }
  Implementation::Tile& tile = job.tiles[task.tile];
  // Run by two callers at once: both have the same pixels, and one has come first.
  if (tile.current && tile.current->passes > task.pass) return false;
  if (!complete) {
    job.returned.push_back(task.tile);
    return false;
  }
  outdated = std::exchange(tile.finished, std::exchange(tile.current, std::move(made)));
  job.pixels_done += tile.current->pixels.size();
  if (++job.tiles_done < job.tiles.size()) return false;
  job.begin_next_pass();
  return true;
}

void RenderJob::cancel() {
  Implementation& job = *implementation_;
  const std::lock_guard lock(job.mutex);
  if (job.ended()) return;
  job.end = Clock::now();
  job.cancelled = true;
  job.interrupted = true;
  job.drop_unfinished_pass();
}

bool RenderJob::ended() const { return implementation_->interrupted; }

Progress RenderJob::progress() const {
  const Implementation& job = *implementation_;
  const std::lock_guard lock(job.mutex);
  Progress progress;
  progress.passes_done = job.passes_done;
  progress.pass_count = job.finished ? job.passes_done : job.pass_count;
  progress.samples_per_pixel = job.samples_done;
  progress.tiles_done = job.tiles_done;
  progress.samples_done = job.samples_done * job.crop_pixels + job.pixels_done * job.pass_samples;
  progress.samples_planned = job.samples_in_all() * job.crop_pixels;
  progress.invalid_samples = job.invalid_samples;
  progress.rays = job.rays;
  progress.render_seconds = job.elapsed_seconds();
  progress.cpu_seconds = job.cpu_seconds;
  progress.finished = job.finished;
  if (job.finished) {
    progress.samples_planned = progress.samples_done;
  } else if (job.has_budget() && progress.render_seconds > 0) {
    const double share = progress.render_seconds / job.settings.time_budget_seconds;
    const double extrapolated = static_cast<double>(progress.samples_done) / std::fmin(1.0, share);
    if (extrapolated < static_cast<double>(progress.samples_planned)) {
      progress.samples_planned = static_cast<uint64_t>(extrapolated);
    }
  }
  return progress;
}

uint32_t RenderJob::tile_count() const { return implementation_->grid.count(); }

TilePixels RenderJob::tile(uint32_t index) const {
  const Implementation& job = *implementation_;
  if (index >= job.grid.count()) {
    throw Error(ErrorKind::invalid_argument, "NO_SUCH_TILE", "there is no tile " + std::to_string(index));
  }
  TilePixels pixels;
  pixels.window = job.grid.window(index);
  TileFilmPointer film;
  {
    const std::lock_guard lock(job.mutex);
    film = job.tiles[index].current;
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
  uint32_t passes = 0;
  const std::vector<TileFilmPointer> films = job.finished_films(passes);
  Image image;
  image.window = job.settings.film.crop;
  image.full_width = job.settings.film.width;
  image.full_height = job.settings.film.height;
  image.rgb.resize(static_cast<size_t>(job.crop_pixels) * 3);
  image.variance.resize(image.rgb.size());
  for (uint32_t index = 0; index < films.size(); ++index) {
    if (!films[index]) continue;
    const TileFilm& film = *films[index];
    image.samples = film.samples;
    const scene::Window window = job.grid.window(index);
    size_t pixel = 0;
    for (int32_t y = window.y - image.window.y; y < window.y - image.window.y + window.height; ++y) {
      for (int32_t x = window.x - image.window.x; x < window.x - image.window.x + window.width;
           ++x, ++pixel) {
        const size_t first =
            (static_cast<size_t>(y) * static_cast<size_t>(image.window.width) + static_cast<size_t>(x)) * 3;
        const Vec3d mean = film.pixels[pixel].mean(film.samples);
        const Vec3d error = film.pixels[pixel].standard_error(film.samples);
        for (int channel = 0; channel < 3; ++channel) {
          image.rgb[first + static_cast<size_t>(channel)] = to_pixel(mean[channel]);
          image.variance[first + static_cast<size_t>(channel)] = to_pixel(error[channel] * error[channel]);
        }
      }
    }
  }
  return image;
}

std::optional<double> RenderJob::relative_noise() const {
  const Implementation& job = *implementation_;
  uint32_t passes = 0;
  const std::vector<TileFilmPointer> films = job.finished_films(passes);
  if (passes == 0) return std::nullopt;
  const std::lock_guard lock(job.noise_mutex);
  if (passes != job.noise_passes) {
    std::vector<const TileFilm*> tiles;
    tiles.reserve(films.size());
    for (const TileFilmPointer& film : films) tiles.push_back(film.get());
    job.noise = render::relative_noise(tiles);
    job.noise_passes = passes;
  }
  return job.noise > 0 ? std::optional(job.noise) : std::nullopt;
}

}  // namespace fogbank::render
