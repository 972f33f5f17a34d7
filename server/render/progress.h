// What a rendering job tells about itself.
#pragma once

#include <cstdint>
#include <optional>
#include <vector>

#include "integrators/integrator.h"

namespace fogbank::render {

/// Distance to the reference image, whose own noise is in it. A pixel's relative error is the difference of
/// the luminances over that of the reference plus a tenth of the reference's mean luminance.
struct TrueError {
  /// Root mean square of the relative errors without the largest 0.1 %: what ErrorEstimate::error estimates.
  double relative_error = 0;
  double median = 0;         ///< of the relative errors
  double percentile_99 = 0;  ///< of the relative errors
  /// Mean over pixels, without the largest 0.1 %, and channels of (image - reference)^2 / (m^2 + 0.01), with
  /// m the reference's mean over the 5 x 5 pixels around, as far as they are inside the window.
  double relative_mse = 0;
};

/// How good an image is thought to be. Shares of the error are root mean squares over pixels, relative to the
/// pixel's luminance plus a tenth of the image's mean luminance, without the largest 0.1 %: the formula is at
/// `relative_disagreement` in film.h.
struct ErrorEstimate {
  std::optional<double> noise;  ///< from the half buffers; none with one sample of a layer or a black image
  double disagreement = 0;      ///< of the half buffers, which `noise` is made of: Progression::noise
  double bias = 0;  ///< of the cache: extrapolation and noise of records, as CacheView tells; or of blur
  std::optional<double> error;          ///< sqrt(noise^2 + bias^2); none without noise
  std::optional<TrueError> true_error;  ///< with a reference image
};

/// The job as it was when a pass was finished.
struct HistoryEntry {
  double cpu_seconds = 0;
  double wall_seconds = 0;
  uint32_t samples = 0;  ///< per pixel
  uint64_t records = 0;  ///< records_reused + records_new
  uint64_t epoch = 0;
  ErrorEstimate estimate;
};

struct Progress {
  uint32_t passes_done = 0;
  uint32_t pass_count = 0;         ///< planned; 0 while an error target or a time budget leaves it open
  uint32_t samples_per_pixel = 0;  ///< of the finished passes
  uint32_t tiles_done = 0;         ///< of the current pass
  uint64_t samples_done = 0;       ///< camera samples in the film
  /// Camera samples of the whole job; with a time budget extrapolated from the rate.
  uint64_t samples_planned = 0;
  /// Not finite or negative, taken as black: an error of the integrator if not 0.
  uint64_t invalid_samples = 0;
  uint64_t rays = 0;
  double render_seconds = 0;  ///< wall, since the first task began; stands still when the job has ended
  double cpu_seconds = 0;     ///< thread CPU time spent in tasks

  uint32_t stage = 0;               ///< preparations begun; 0 where the integrator prepares nothing
  double stage_error = 0;           ///< what the present stage aims at, CacheTarget::error
  bool preparing = false;           ///< a preparation runs
  double preparation_fraction = 0;  ///< of the present stage that is done, about; 0 to 1
  uint64_t epoch = 0;               ///< of the cache, as last published
  uint64_t records_reused = 0;      ///< as integrators::CacheCounts
  uint64_t records_new = 0;
  ErrorEstimate estimate;                        ///< of the last finished pass
  std::vector<integrators::Decision> decisions;  ///< of the integrator, once it has prepared

  bool finished = false;  ///< the image is final (not set by `cancel`)
};

}  // namespace fogbank::render
