// How the samples of a pixel are split into passes. The split never changes the image (render_job.h); it
// decides how soon a watcher sees a whole picture, how much is lost when a job ends early, and how long a
// thread is bound to a task.
#pragma once

#include <cstdint>
#include <limits>

namespace fogbank::render {

inline constexpr uint32_t no_limit = std::numeric_limits<uint32_t>::max();

/// Samples of the pass that follows `samples_done`; 0 when all are done. 1, 1, 2, 4, 8, ...: each pass
/// doubles the samples, so that the noise visibly falls with each and the first picture comes at once. Then
/// the size stays, at an eighth of all samples (what a budget or a crash can lose), or where a task reaches
/// 2^16 samples, a fraction of a second on one core (which bounds how unfairly jobs that take turns by task
/// can share a core, and the time between two updates of a tile), or at `most_samples`, >= 1.
uint32_t samples_of_next_pass(uint32_t samples_done, uint32_t samples_in_all, uint32_t pixels_of_a_tile,
                              uint32_t most_samples = no_limit);

/// Number of passes that `samples_of_next_pass` makes.
uint32_t count_passes(uint32_t samples_in_all, uint32_t pixels_of_a_tile, uint32_t most_samples = no_limit);

/// What is known of time when a pass is planned.
struct TimeLeft {
  double seconds = 0;         ///< until the end of the budget
  double budget_seconds = 0;  ///< the whole
  double pace = 0;            ///< seconds that one sample of every pixel takes; > 0
};

/// The same under a time budget: at most what, at the pace so far, takes an eighth of the budget and ends
/// before nine tenths of the time that is left; 0 when not even one sample does. The tenth is for an uneven
/// pace: a pass that doesn't end in time is lost. The first pass (`samples_done` = 0) isn't restricted.
uint32_t samples_of_next_pass(uint32_t samples_done, uint32_t samples_in_all, uint32_t pixels_of_a_tile,
                              const TimeLeft& time, uint32_t most_samples = no_limit);

}  // namespace fogbank::render
