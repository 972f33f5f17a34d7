// What a job does next: make the cache finer, or take more samples.
#pragma once

#include <cstdint>
#include <optional>

#include "integrators/integrator.h"
#include "render/render_settings.h"

namespace fogbank::render {

/// A step of a job.
struct Step {
  enum class Kind : uint8_t { prepare, pass, finish };
  Kind kind = Kind::finish;
  integrators::CacheTarget target;  ///< prepare
  std::optional<double>
      latest_end_seconds;  ///< prepare: dropped when it isn't done then, since the job's begin
  uint32_t samples = 0;    ///< pass: per pixel
};

/// How a job stands.
struct Standing {
  uint32_t samples = 0;  ///< per pixel
  double elapsed_seconds = 0;
};

class Progression {
 public:
  explicit Progression(const RenderSettings& settings);

  Step next(const Standing& standing);
  /// The integrator has nothing to prepare.
  void nothing_to_prepare() { prepares_ = false; }
  void stage_took(double seconds) { preparation_seconds_ += seconds; }
  /// Passes in all; 0 while a target leaves it open.
  uint32_t pass_count() const;

 private:
  uint32_t samples_in_all() const { return static_cast<uint32_t>(settings_.samples_per_pixel); }
  uint32_t tile_pixels() const { return static_cast<uint32_t>(settings_.tile_size * settings_.tile_size); }

  RenderSettings settings_;
  bool prepares_ = true;
  uint32_t stages_ = 0;
  double preparation_seconds_ = 0;
};

}  // namespace fogbank::render
