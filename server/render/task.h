// The work of a rendering job, cut into what one thread does at a time.
#pragma once

#include <cstdint>
#include <variant>

#include "scene/sensor.h"

namespace fogbank::render {

/// Decides what comes next: plans the next round of a preparation, judges the pass that ended, chooses
/// between a finer cache and more samples. Runs alone.
struct PlanTask {};

/// One of a round of tasks.
struct RoundTask {
  uint32_t round = 0;  ///< counted over the whole job
  uint32_t index = 0;
};

/// One task of a round of a preparation (integrators::Preparation).
struct PreparationTask : RoundTask {};

/// Looks at the cache along the camera rays of a row of pixels (cache_survey.h).
struct SurveyTask : RoundTask {};

/// One tile of one pass: samples [first_sample, first_sample + sample_count) of each of its pixels.
struct TileTask {
  uint32_t tile = 0;
  uint32_t pass = 0;
  scene::Window window;
  uint32_t first_sample = 0;
  uint32_t sample_count = 0;
  uint32_t first_cached_sample = 0;  ///< samples of an older epoch, before this one, leave the cached layer
  uint32_t cached_sample_count = 0;  ///< the first so many samples look at the cache, <= sample_count
};

/// Samples of all its pixels.
inline double pixel_samples(const TileTask& task) {
  return double{1} * task.window.width * task.window.height * task.sample_count;
}

using Task = std::variant<PlanTask, PreparationTask, SurveyTask, TileTask>;

}  // namespace fogbank::render
