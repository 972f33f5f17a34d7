// What a job does next: make the cache finer, or take more samples. Without a time budget a function of
// settings and results alone: neither of time nor of tiles and threads.
#pragma once

#include <cstdint>
#include <optional>
#include <utility>
#include <vector>

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
  uint32_t samples = 0;         ///< pass: per pixel
  uint32_t cached_samples = 0;  ///< pass: the first of these, which look at the cache if there is one
};

/// How a job stands.
struct Standing {
  uint32_t samples = 0;  ///< per pixel, in the film
  double elapsed_seconds = 0;
  double reserved_seconds = 0;  ///< that must be left at the end, for AOVs
  uint64_t records_new = 0;
  std::optional<double> noise;  ///< of the last pass; none: not known yet
  double bias = 0;              ///< of the last pass
  double disagreement = 0;      ///< of the last pass's half buffers (film.h)
  double cached_share = 1;      ///< of samples, that should look at the cache (film.h)
  uint32_t cached_samples = 0;  ///< per pixel, that looked at the cache as it is
  bool bias_falls = false;      ///< with more samples
};

/// What the cache's stages come down to: its share of the error that is asked for.
double cache_error(const RenderSettings& settings);

/// What the integrator is to know for such a picture: samples and error to reckon with included.
integrators::IntegratorSettings integrator_settings(const RenderSettings& settings);

class Progression {
 public:
  struct Look {
    uint32_t samples = 0;
    double disagreement = 0;
  };
  /// Between two steps: what it knows besides what it was made with.
  struct State {
    bool prepares = true;  ///< finer stages are possible
    uint32_t stages = 0;
    double stage_error = 0;        ///< of the last stage
    double aim = 0;                ///< what the stages come down to
    bool begin_with_pass = false;  ///< the stage before has not been seen yet
    uint32_t decision_at = 0;      ///< samples at which results are looked at next
    std::vector<Look> looks;       ///< at results of this stage, of so many samples that their noise counts
    uint32_t cached_until = 0;     ///< the number of the first sample that doesn't look at the cache
    double preparation_seconds = 0;
    double last_stage_seconds = 0;
    double growth = 0;     ///< of seconds from stage to stage
    double last_bias = 0;  ///< when it was last found too large; 0: never
  };

  /// `most_samples`: of a pass, >= 1.
  Progression(const RenderSettings& settings, uint32_t most_samples);

  const State& state() const { return state_; }
  /// Goes on as the one would that `state` is of, which was made with the same settings.
  void restore(State state) { state_ = std::move(state); }

  Step next(const Standing& standing);
  /// The integrator has nothing to prepare.
  void nothing_to_prepare() { state_.prepares = false; }
  /// The stage that the last step began has ended. `dropped`: for want of time.
  void stage_ended(double seconds, bool dropped);
  /// Noise of an image of `samples` a pixel whose half buffers disagree by so much (relative_disagreement).
  /// Where the variance V of n samples falls as n^-b, as sequences make it fall, half of the samples have 2^b
  /// times that of all; with E[(A - B)^2] = 2 V(n / 2) - 2 C and V(n) = (V(n / 2) + C) / 2, C the halves'
  /// covariance, the square of the disagreement, E[(A - B)^2] / 4, is (2^b - 1) V(n). b is what it fell by
  /// since the results of this stage were looked at with half of the samples or less, from 1 (independent
  /// samples) to 2; 1 while they were not, or where the pixels are too few to tell.
  double noise(double disagreement, uint32_t samples) const;
  /// Passes in all; 0 while a target leaves it open.
  uint32_t pass_count() const;

 private:
  std::optional<Step> first_steps(const Standing& standing);
  bool good_enough(const Standing& standing) const;
  /// The target of the next stage, if there should be one.
  std::optional<double> finer_target(const Standing& standing);
  Step prepare(double error, bool preview, const Standing& standing);
  Step pass(const Standing& standing) const;
  /// Looks at results: what follows from them until they are looked at again.
  void look(const Standing& standing);
  double seconds_left(const Standing& standing) const;
  double seconds_of_a_sample(const Standing& standing) const;
  bool fits(const Standing& standing) const;

  RenderSettings settings_;
  uint32_t most_samples_;  ///< of a pass
  State state_;
};

}  // namespace fogbank::render
