#include "render/passes.h"

#include <algorithm>
#include <cmath>

namespace fogbank::render {

namespace {

constexpr uint32_t samples_of_a_task = 1u << 16;
constexpr uint32_t least_share = 8;  // no pass is longer than 1 / least_share of the whole
constexpr double usable_share_of_rest = 0.9;

}  // namespace

uint32_t samples_of_next_pass(uint32_t samples_done, uint32_t samples_in_all, uint32_t pixels_of_a_tile,
                              uint32_t most_samples) {
  const uint32_t left = samples_in_all - std::min(samples_done, samples_in_all);
  const uint32_t share = (samples_in_all + least_share - 1) / least_share;
  const uint32_t task = std::max(1u, samples_of_a_task / std::max(1u, pixels_of_a_tile));
  return std::min({left, std::max(1u, samples_done), share, task, most_samples});
}

uint32_t count_passes(uint32_t samples_in_all, uint32_t pixels_of_a_tile, uint32_t most_samples) {
  uint32_t passes = 0;
  uint32_t done = 0;
  while (const uint32_t samples =
             samples_of_next_pass(done, samples_in_all, pixels_of_a_tile, most_samples)) {
    done += samples;
    ++passes;
  }
  return passes;
}

uint32_t samples_of_next_pass(uint32_t samples_done, uint32_t samples_in_all, uint32_t pixels_of_a_tile,
                              const TimeLeft& time, uint32_t most_samples) {
  const uint32_t unrestricted =
      samples_of_next_pass(samples_done, samples_in_all, pixels_of_a_tile, most_samples);
  if (samples_done == 0) return unrestricted;
  if (!(time.seconds > 0)) return 0;
  const double fits = std::floor(time.seconds * usable_share_of_rest / time.pace);
  if (!(fits >= 1)) return 0;
  const double share = std::fmax(1.0, std::floor(time.budget_seconds / least_share / time.pace));
  return static_cast<uint32_t>(std::fmin(unrestricted, std::fmin(fits, share)));
}

}  // namespace fogbank::render
