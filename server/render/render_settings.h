// What a rendering job is told: settings, limits, their check.
#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "integrators/integrator.h"
#include "scene/sensor.h"

namespace fogbank::render {

/// Limits of one job.
struct RenderLimits {
  static constexpr int32_t film_side = 16384;               ///< pixels
  static constexpr int64_t crop_pixels = int64_t{1} << 26;  ///< width * height of the crop window
  static constexpr int32_t samples_per_pixel = 1 << 20;
  static constexpr int32_t path_depth = 1 << 20;  ///< of max_depth and rr_depth
  static constexpr int32_t smallest_tile = 8;
  static constexpr int32_t largest_tile = 128;  ///< uncompressed 32-bit tiles stay below 256 KiB
  static constexpr double time_budget_seconds = 30.0 * 24 * 3600;
  static constexpr double smallest_error = 1e-6;
  static constexpr double largest_error = 10;
  static constexpr int64_t most_records = int64_t{1} << 32;
};

enum class TileOrder : uint8_t { scan, spiral };

/// What the cache says about each pixel, as a channel of the final image (integrators::CacheView).
enum class Aov : uint8_t { radius, record_density, rejected, variance, bias };
/// "radius", "record-density", "rejected", "variance", "bias"; also the channel's name, after "cache.".
std::string name_of(Aov aov);
/// Throws Error(invalid_argument, "UNKNOWN_AOV") naming the known ones.
Aov parse_aov(const std::string& name);

/// "auto", "direct" or "cached".
std::string name_of(integrators::SingleScattering technique);
/// Throws Error(invalid_argument, "INVALID_RENDER_SETTINGS") naming the known ones.
integrators::SingleScattering parse_single_scattering(const std::string& name);

/// What the image should be, to tell the true error of every pass. `rgb` has the shape of Image::rgb.
struct ReferenceImage {
  scene::Window window;
  std::vector<float> rgb;
};

/// Everything an image depends on besides the scene, and how it is to be worked on.
///
/// A job works until the first of these is met: `error`, `time_budget_seconds`, `samples_per_pixel`. Where
/// neither of the first two nor `record_budget` is given, an integrator with a cache prepares it for
/// `CacheTarget`'s default error.
struct RenderSettings {
  std::string integrator = "volpath";
  integrators::IntegratorSettings integrator_settings;
  int32_t samples_per_pixel = 16;  ///< the upper bound when `error` or a time budget is given
  /// 0 = none. Wall time since the first task began; the image is that of the last pass that ended within it,
  /// but of the first pass at least.
  double time_budget_seconds = 0;
  /// 0 = none; 1e-6 to 10. Estimated relative error of the image that is good enough:
  /// Progress::estimated_error.
  double error = 0;
  /// 0 = none. The cache is made finer, whatever it takes, until the job has made that many records.
  int64_t record_budget = 0;
  uint64_t seed = 0;
  scene::Film film;        ///< size, crop and filter; from the scene unless overridden
  scene::Sensor sensor;    ///< from the scene unless overridden
  int32_t tile_size = 32;  ///< pixels a side
  TileOrder tile_order = TileOrder::spiral;
  std::optional<scene::Window> first_region;        ///< tiles that touch it come first
  std::vector<Aov> aovs;                            ///< each once; in the order of the channels
  std::shared_ptr<const ReferenceImage> reference;  ///< null: none; its window must be the crop
  /// No picture: the job ends when the cache holds what passes need, as a FillJob of this one camera does.
  /// Not with a time budget, which would end it earlier than that.
  bool fill_only = false;
};

/// Throws Error(invalid_argument, "INVALID_RENDER_SETTINGS") for anything that is out of range or not finite;
/// the message begins with the field's name and a colon, e.g. "film.crop: ...".
void validate(const RenderSettings& settings);

}  // namespace fogbank::render
