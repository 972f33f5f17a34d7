// A progressive rendering as a set of tile tasks. The caller (the service's scheduler, a test, a farm worker)
// owns the threads: it asks for the next task, runs it on any thread, and reads the film. The image depends
// on scene, settings and the number of finished samples per pixel only: sample i of film pixel (x, y) draws
// from RandomStream(seed, x, y, i), and the samples of a pixel are summed in the order of i, however they are
// split into passes and tiles.
#pragma once

#include <atomic>
#include <cstdint>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <vector>

#include "core/vector.h"
#include "integrators/integrator.h"
#include "scene/scene.h"
#include "scene/sensor.h"

namespace fogbank::transport {
class World;
}

namespace fogbank::render {

/// Limits of one job. Memory of a film: 48 bytes a pixel of the crop window, and 48 more while passes follow
/// each other (film.h), so at most 6.4 GB; `RenderJob::image` takes 24 bytes a pixel on top.
struct RenderLimits {
  static constexpr int32_t film_side = 16384;               ///< pixels
  static constexpr int64_t crop_pixels = int64_t{1} << 26;  ///< width * height of the crop window
  static constexpr int32_t samples_per_pixel = 1 << 20;
  static constexpr int32_t path_depth = 1 << 20;  ///< of max_depth and rr_depth
  static constexpr int32_t smallest_tile = 8;
  static constexpr int32_t largest_tile = 128;  ///< uncompressed 32-bit tiles stay below 256 KiB
  static constexpr double time_budget_seconds = 30.0 * 24 * 3600;
};

enum class TileOrder : uint8_t { scan, spiral };

/// Everything an image depends on besides the scene, and how it is to be worked on.
struct RenderSettings {
  std::string integrator = "volpath";
  integrators::IntegratorSettings integrator_settings;
  int32_t samples_per_pixel = 16;  ///< the upper bound when a time budget is given
  /// 0 = none. Wall time since the first task began; the image is that of the last pass that ended within it,
  /// but of the first pass at least.
  double time_budget_seconds = 0;
  uint64_t seed = 0;
  scene::Film film;        ///< size, crop and filter; from the scene unless overridden
  scene::Sensor sensor;    ///< from the scene unless overridden
  int32_t tile_size = 32;  ///< pixels a side
  TileOrder tile_order = TileOrder::spiral;
  std::optional<scene::Window> first_region;  ///< tiles that touch it come first
};

/// Throws Error(invalid_argument, "INVALID_RENDER_SETTINGS") for anything that is out of range or not finite;
/// the message begins with the field's name and a colon, e.g. "film.crop: ...".
void validate(const RenderSettings& settings);

/// One tile of one pass: samples [first_sample, first_sample + sample_count) of each of its pixels.
struct TileTask {
  uint32_t tile = 0;
  uint32_t pass = 0;
  scene::Window window;
  uint32_t first_sample = 0;
  uint32_t sample_count = 0;
};

struct Progress {
  uint32_t passes_done = 0;
  uint32_t pass_count = 0;         ///< planned; 0 while a time budget leaves it open
  uint32_t samples_per_pixel = 0;  ///< of the finished passes
  uint32_t tiles_done = 0;         ///< of the current pass
  uint64_t samples_done = 0;       ///< camera samples in the film
  uint64_t samples_planned =
      0;  ///< camera samples of the whole job; with a time budget extrapolated from the rate
  uint64_t invalid_samples =
      0;  ///< not finite or negative, taken as black: an error of the integrator if not 0
  uint64_t rays = 0;
  double render_seconds = 0;  ///< wall, since the first task began; stands still when the job has ended
  double cpu_seconds = 0;     ///< thread CPU time spent in tasks
  bool finished = false;      ///< the image is final (not set by `cancel`)
};

/// A tile as it is now: mean radiance over all finished samples of each pixel.
struct TilePixels {
  scene::Window window;
  uint32_t pass = 0;       ///< number of passes in it
  uint32_t samples = 0;    ///< per pixel
  std::vector<float> rgb;  ///< height * width * 3; finite, no denormals
};

/// Whole image over finished passes.
struct Image {
  scene::Window window;    ///< data window: the crop
  int32_t full_width = 0;  ///< display window
  int32_t full_height = 0;
  uint32_t samples = 0;    ///< per pixel
  std::vector<float> rgb;  ///< mean, height * width * 3; finite, no denormals
  /// Estimated variance of `rgb`, same shape, from the two half buffers (film.h); 0 with one sample. One
  /// degree of freedom a pixel: right on average, rough for any one pixel.
  std::vector<float> variance;
};

class RenderJob {
 public:
  /// Throws like `validate` and `make_integrator`.
  RenderJob(std::shared_ptr<const transport::World> world, const RenderSettings& settings);
  /// With an integrator that is made already; `settings.integrator` is only a name then.
  RenderJob(std::unique_ptr<const integrators::Integrator> integrator, RenderSettings settings);
  ~RenderJob();

  const RenderSettings& settings() const;

  /// Next task to run, or nullopt when there is none now: all are handed out (a pass begins only when the one
  /// before is complete, so that every finished pass is a whole image), or the job is finished or cancelled.
  /// `ended` tells these apart; note that a time budget can end the job right here. Thread-safe.
  std::optional<TileTask> next_task();
  /// Renders a task and adds it to the film; returns true when that completed a pass. The film is left
  /// unchanged, and the result is false, when `stop` is set meanwhile (polled every few samples; the task is
  /// handed out again later), when the job is cancelled or out of time, and when the task is in the film
  /// already. An exception of the integrator leaves the film unchanged, too. Thread-safe. Leaves the thread
  /// prepared for rendering
  /// (`scene::prepare_render_thread`).
  bool run(const TileTask& task, const std::atomic<bool>& stop);
  /// No task is handed out afterwards, and those that run leave the film unchanged.
  void cancel();
  /// Finished or cancelled?
  bool ended() const;

  Progress progress() const;
  uint32_t tile_count() const;
  /// Tile `index` (row by row, from the upper left), the unfinished pass included. When the job ends by its
  /// time budget or by `cancel`, tiles of an unfinished pass fall back to the last finished one, so that the
  /// tiles together always end as `image()`; `pass` goes down by one then. Never torn; waits for nothing.
  /// Throws Error(invalid_argument, "NO_SUCH_TILE").
  TilePixels tile(uint32_t index) const;
  Image image() const;
  /// Noise of the image, as a share of its brightness; nullopt with one sample or a black image. With L the
  /// mean luminance of a pixel, V its variance from the half buffers and M the mean of L over the image: the
  /// root mean square of sqrt(V) / (L + M / 10) over the pixels, without the largest 0.1 % of them, as single
  /// fireflies would decide it otherwise. Takes about 20 ns a pixel; kept until the next pass is finished.
  std::optional<double> relative_noise() const;

 private:
  struct Implementation;
  std::unique_ptr<Implementation> implementation_;
};

}  // namespace fogbank::render
