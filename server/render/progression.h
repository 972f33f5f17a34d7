// What a job does next: make the cache finer, or take more samples. Without a time budget a function of
// settings and results alone: neither of time nor of tiles and threads.
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
  /// prepare: dropped when it isn't done then; seconds since the job's begin.
  std::optional<double> latest_end_seconds;
  uint32_t samples = 0;  ///< pass: per pixel
};

/// How a job stands.
struct Standing {
  uint32_t samples = 0;  ///< per pixel, in the film
  double elapsed_seconds = 0;
  double reserved_seconds = 0;  ///< that must be left at the end, for AOVs
  uint64_t records_new = 0;
  std::optional<double> noise;  ///< of the last pass; none: not known yet
  double bias = 0;              ///< of the last pass
};

/// What the cache's stages come down to: its share of the error that is asked for.
double cache_error(const RenderSettings& settings);

/// What the integrator is to know for such a picture: samples and error to reckon with included.
integrators::IntegratorSettings integrator_settings(const RenderSettings& settings);

class Progression {
 public:
  /// `most_samples`: of a pass, >= 1.
  Progression(const RenderSettings& settings, uint32_t most_samples);

  Step next(const Standing& standing);
  /// The integrator has nothing to prepare.
  void nothing_to_prepare() { prepares_ = false; }
  /// The stage that the last step began has ended. `dropped`: for want of time.
  void stage_ended(double seconds, bool dropped);
  /// Passes in all; 0 while a target leaves it open.
  uint32_t pass_count() const;

 private:
  std::optional<Step> first_steps(const Standing& standing);
  bool good_enough(const Standing& standing) const;
  /// The target of the next stage, if there should be one.
  std::optional<double> finer_target(const Standing& standing);
  Step prepare(double error, bool preview, const Standing& standing);
  Step pass(const Standing& standing) const;
  double seconds_left(const Standing& standing) const;
  double seconds_of_a_sample(const Standing& standing) const;
  bool fits(const Standing& standing) const;

  RenderSettings settings_;
  uint32_t most_samples_;  ///< of a pass
  bool prepares_ = true;   ///< finer stages are possible
  uint32_t stages_ = 0;
  double stage_error_ = 0;        ///< of the last stage
  double aim_ = 0;                ///< what the stages come down to
  bool begin_with_pass_ = false;  ///< the stage before has not been seen yet
  uint32_t decision_at_ = 0;      ///< samples at which results are looked at next
  double preparation_seconds_ = 0;
  double last_stage_seconds_ = 0;
  double growth_ = 0;     ///< of seconds from stage to stage
  double last_bias_ = 0;  ///< when it was last found too large; 0: never
};

}  // namespace fogbank::render
