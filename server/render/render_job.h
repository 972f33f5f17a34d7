// A progressive rendering as a set of tile tasks. The caller (the service's scheduler, a test, a farm worker)
// owns the threads: it asks for the next task, runs it on any thread, and reads the film. The image depends
// on scene, settings and the number of finished passes only.
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

enum class TileOrder : uint8_t { scan, spiral };

/// Everything an image depends on besides the scene, and how it is to be worked on.
struct RenderSettings {
  std::string integrator = "volpath";
  integrators::IntegratorSettings integrator_settings;
  int32_t samples_per_pixel = 16;  ///< 1 .. 2^20; the upper bound when a time budget is given
  double time_budget_seconds =
      0;  ///< 0 = none; stops after the last pass that ended within it (at least one)
  uint64_t seed = 0;
  scene::Film film;        ///< size, crop and filter; from the scene unless overridden
  scene::Sensor sensor;    ///< from the scene unless overridden
  int32_t tile_size = 32;  ///< 8 .. 128
  TileOrder tile_order = TileOrder::spiral;
  std::optional<scene::Window> first_region;  ///< tiles that touch it come first
};

/// Throws Error(invalid_argument) naming the field for anything out of range (sizes 1 .. 16384 a side and
/// 2^27 pixels in all).
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
  uint32_t pass_count = 0;    ///< planned
  uint64_t samples_done = 0;  ///< camera samples, whole film
  uint64_t samples_planned = 0;
  uint64_t rays = 0;
  double render_seconds = 0;  ///< wall, since the first task started
  double cpu_seconds = 0;     ///< thread CPU time spent in tasks
  bool finished = false;
};

/// A tile as it is now: mean radiance over all finished samples of each pixel.
struct TilePixels {
  scene::Window window;
  uint32_t pass = 0;       ///< number of passes in it
  uint32_t samples = 0;    ///< per pixel
  std::vector<float> rgb;  ///< height * width * 3
};

/// Whole image over finished passes.
struct Image {
  scene::Window window;    ///< data window: the crop
  int32_t full_width = 0;  ///< display window
  int32_t full_height = 0;
  uint32_t samples = 0;    ///< per pixel
  std::vector<float> rgb;  ///< mean, height * width * 3
  std::vector<float>
      variance;  ///< variance of the mean, same shape; from the two half buffers (0 with one sample)
};

class RenderJob {
 public:
  /// Throws like `validate` and `make_integrator`.
  RenderJob(std::shared_ptr<const transport::World> world, RenderSettings settings);
  ~RenderJob();

  const RenderSettings& settings() const;

  /// Next task to run, or nullopt when there is none now: all are handed out (a pass begins only when the one
  /// before is complete, so that every finished pass is a whole image), or the job is finished or cancelled.
  /// Thread-safe.
  std::optional<TileTask> next_task();
  /// Renders a task and adds it to the film. Thread-safe; `stop` is polled between pixels rows and leaves the
  /// film unchanged when set. Returns true when this task completed a pass.
  bool run(const TileTask& task, const std::atomic<bool>& stop);
  /// No task is handed out afterwards.
  void cancel();

  Progress progress() const;
  uint32_t tile_count() const;
  TilePixels tile(uint32_t index) const;
  Image image() const;

 private:
  struct Implementation;
  std::unique_ptr<Implementation> implementation_;
};

}  // namespace fogbank::render
