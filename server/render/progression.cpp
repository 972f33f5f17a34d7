#include "render/progression.h"

#include "render/passes.h"

namespace fogbank::render {

namespace {

/// Share of a time budget that preparations before the first pass may take.
constexpr double preparation_share = 0.5;

}  // namespace

Progression::Progression(const RenderSettings& settings) : settings_(settings) {}

uint32_t Progression::pass_count() const {
  return settings_.time_budget_seconds > 0 ? 0 : count_passes(samples_in_all(), tile_pixels());
}

Step Progression::next(const Standing& standing) {
  const double budget = settings_.time_budget_seconds;
  if (prepares_ && stages_ == 0) {
    ++stages_;
    Step step;
    step.kind = Step::Kind::prepare;
    if (settings_.error > 0) step.target.error = settings_.error;
    if (budget > 0) step.latest_end_seconds = preparation_share * budget;
    return step;
  }
  Step step;
  step.kind = Step::Kind::pass;
  if (budget > 0 && standing.samples > 0) {
    const double pace = (standing.elapsed_seconds - preparation_seconds_) / standing.samples;
    step.samples = samples_of_next_pass(standing.samples, samples_in_all(), tile_pixels(),
                                        {budget - standing.elapsed_seconds, budget, pace});
  } else {
    step.samples = samples_of_next_pass(standing.samples, samples_in_all(), tile_pixels());
  }
  if (step.samples == 0) step.kind = Step::Kind::finish;
  return step;
}

}  // namespace fogbank::render
