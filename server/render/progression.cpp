#include "render/progression.h"

#include <algorithm>
#include <cmath>

#include "render/passes.h"

namespace fogbank::render {

namespace {

/// Target of the first stage, which is there to show something soon.
constexpr double preview_error = 0.5;
/// From one stage to the next, where an error is asked for: stages in between only show the picture growing.
constexpr double stage_factor = 0.25;
/// The same where the outcome decides how far it goes.
constexpr double cautious_factor = 0.5;
/// No finer for a budget of records: a scene may need fewer than the budget, whatever the error.
constexpr double finest_for_records = 1e-4;
/// Share of an error target that bias may have, as noise and bias add up by squares: both the same.
constexpr double bias_share = 0.7;
/// A stage that leaves more of the bias than that is the last one.
constexpr double worthwhile = 0.9;
/// Samples between two looks at the results, as a share of the samples so far: what is done in vain at most.
constexpr double looks_apart = 0.25;
/// Relative noise of one sample of a pixel, the power of the number of samples that it goes with, and seconds
/// that one takes: typical ones, for predictions of cost alone.
constexpr double noise_of_a_sample = 0.13;
constexpr double noise_power = -0.73;
constexpr double seconds_of_a_sample = 5e-6;
/// Samples behind an estimate of noise that is believed.
constexpr uint64_t least_samples_of_film = 1024;
constexpr uint32_t least_samples_of_pixel = 4;

// Of a time budget:
/// Share that the stage before the first pass may take.
constexpr double first_stage_share = 0.5;
/// Share of the time left that a stage is expected to take at most, and the share after which it is dropped.
constexpr double stage_share = 0.4;
constexpr double stage_limit = 0.7;
/// Pixels from which the fall of the noise is known to some ten per cent; samples from which either half has
/// two, about.
constexpr int64_t least_pixels_for_exponent = 1024;
constexpr uint32_t least_samples_for_exponent = 4;
/// Growth of a stage's time, while only the preview's is known; and limits to what is measured.
constexpr double first_growth = 3;
constexpr double least_growth = 1.5;
constexpr double most_growth = 8;

}  // namespace

double cache_error(const RenderSettings& settings) {
  return settings.error > 0 ? bias_share * settings.error : integrators::CacheTarget{}.error;
}

integrators::IntegratorSettings integrator_settings(const RenderSettings& settings) {
  integrators::IntegratorSettings result = settings.integrator_settings;
  const double pixels = static_cast<double>(settings.film.crop.width) * settings.film.crop.height;
  // More would only be finer than the cache.
  const double enough = std::pow(cache_error(settings) / noise_of_a_sample, 1 / noise_power);
  double samples = std::fmin(settings.samples_per_pixel, std::ceil(enough));
  if (settings.time_budget_seconds > 0)
    samples = std::fmin(samples, settings.time_budget_seconds / (seconds_of_a_sample * pixels));
  // Far below what a sum of 64 bits holds.
  result.expected_samples = static_cast<int64_t>(std::fmin(samples * pixels, 1e15));
  result.expected_error = cache_error(settings);
  return result;
}

Progression::Progression(const RenderSettings& settings, uint32_t most_samples)
    : settings_(settings), most_samples_(most_samples) {
  state_.aim = cache_error(settings);
}

uint32_t Progression::pass_count() const {
  if (settings_.time_budget_seconds > 0 || settings_.error > 0 || settings_.record_budget > 0) return 0;
  return count_passes(static_cast<uint32_t>(settings_.samples_per_pixel),
                      static_cast<uint32_t>(settings_.tile_size * settings_.tile_size), most_samples_);
}

void Progression::stage_ended(double seconds, bool dropped) {
  state_.preparation_seconds += seconds;
  state_.growth = state_.stages > 1 ? std::clamp(seconds / std::fmax(state_.last_stage_seconds, 1e-9),
                                                 least_growth, most_growth)
                                    : first_growth;
  state_.last_stage_seconds = seconds;
  if (dropped) state_.prepares = false;
  state_.looks.clear();
}

double Progression::noise(double disagreement, uint32_t samples) const {
  const int64_t pixels = int64_t{settings_.film.crop.width} * settings_.film.crop.height;
  const auto after = std::ranges::partition_point(
      state_.looks, [&](const Look& before) { return 2 * uint64_t{before.samples} <= samples; });
  if (pixels < least_pixels_for_exponent || after == state_.looks.begin() || !(disagreement > 0))
    return disagreement;
  const Look& before = *std::prev(after);
  const double fallen = 2 * std::log(before.disagreement / disagreement);
  const double b = std::clamp(fallen / std::log(static_cast<double>(samples) / before.samples), 1.0, 2.0);
  return disagreement / std::sqrt(std::exp2(b) - 1);
}

void Progression::look(const Standing& standing) {
  if (standing.samples >= least_samples_for_exponent && standing.disagreement > 0)
    state_.looks.push_back({standing.samples, standing.disagreement});
  // What was asked for by number is taken in full.
  state_.cached_until = no_limit;
  if (settings_.error == 0 && settings_.time_budget_seconds == 0) return;
  const uint32_t end =
      state_.decision_at > standing.samples ? state_.decision_at : standing.samples + pass(standing).samples;
  const double wanted = std::ceil(standing.cached_share * end) - standing.cached_samples;
  state_.cached_until = standing.samples + static_cast<uint32_t>(std::clamp(
                                               wanted, 0.0, static_cast<double>(end - standing.samples)));
}

double Progression::seconds_left(const Standing& standing) const {
  return settings_.time_budget_seconds - standing.reserved_seconds - standing.elapsed_seconds;
}

double Progression::seconds_of_a_sample(const Standing& standing) const {
  return (standing.elapsed_seconds - state_.preparation_seconds) / std::max(standing.samples, 1u);
}

Step Progression::prepare(double error, bool preview, const Standing& standing) {
  ++state_.stages;
  state_.stage_error = error;
  state_.begin_with_pass = true;
  Step step;
  step.kind = Step::Kind::prepare;
  step.target = {error, preview};
  if (settings_.time_budget_seconds > 0) {
    const double share = standing.samples == 0 ? first_stage_share : stage_limit;
    step.latest_end_seconds = standing.elapsed_seconds + share * seconds_left(standing);
  }
  return step;
}

Step Progression::pass(const Standing& standing) const {
  const auto in_all = static_cast<uint32_t>(settings_.samples_per_pixel);
  const auto tile_pixels = static_cast<uint32_t>(settings_.tile_size * settings_.tile_size);
  Step step;
  step.kind = Step::Kind::pass;
  if (settings_.time_budget_seconds > 0) {
    step.samples = samples_of_next_pass(
        standing.samples, in_all, tile_pixels,
        {seconds_left(standing), settings_.time_budget_seconds, seconds_of_a_sample(standing)},
        most_samples_);
  } else {
    step.samples = samples_of_next_pass(standing.samples, in_all, tile_pixels, most_samples_);
  }
  if (step.samples == 0) step.kind = Step::Kind::finish;
  if (state_.decision_at > standing.samples)
    step.samples = std::min(step.samples, state_.decision_at - standing.samples);
  step.cached_samples =
      std::min(step.samples, state_.cached_until - std::min(state_.cached_until, standing.samples));
  return step;
}

bool Progression::good_enough(const Standing& standing) const {
  if (settings_.error == 0 || !standing.noise) return false;
  const int64_t pixels = int64_t{settings_.film.crop.width} * settings_.film.crop.height;
  if (standing.samples < least_samples_of_pixel) return false;
  if (standing.samples * static_cast<uint64_t>(pixels) < least_samples_of_film) return false;
  if (std::hypot(*standing.noise, standing.bias) <= settings_.error) return true;
  // What is left is bias, and nothing can be done about that.
  return !state_.prepares && !standing.bias_falls && standing.bias > settings_.error &&
         *standing.noise < 0.5 * standing.bias;
}

bool Progression::fits(const Standing& standing) const {
  const double left = seconds_left(standing) - 2 * seconds_of_a_sample(standing);
  return state_.growth * state_.last_stage_seconds <= stage_share * left;
}

std::optional<double> Progression::finer_target(const Standing& standing) {
  const auto most = static_cast<uint64_t>(settings_.integrator_settings.most_records);
  if (standing.records_new >= most || state_.stage_error <= RenderLimits::smallest_error)
    state_.prepares = false;
  // The cached layer begins anew with a stage: one sample at least must follow.
  if (!state_.prepares || standing.samples >= static_cast<uint32_t>(settings_.samples_per_pixel))
    return std::nullopt;
  const bool timed = settings_.time_budget_seconds > 0;
  if (timed && !fits(standing)) return std::nullopt;
  if (settings_.record_budget > 0 && state_.stage_error > finest_for_records) {
    return std::fmax(cautious_factor * state_.stage_error, finest_for_records);
  }
  if (timed) {
    if (!standing.noise || standing.bias <= *standing.noise) return std::nullopt;
    return std::fmax(cautious_factor * state_.stage_error, RenderLimits::smallest_error);
  }
  if (settings_.record_budget > 0 && settings_.error == 0) return std::nullopt;
  if (settings_.error == 0) {
    // As good as the samples will be, and no better.
    if (!standing.noise) return std::nullopt;
    const double left_in_the_end =
        *standing.noise * std::sqrt(static_cast<double>(standing.samples) / settings_.samples_per_pixel);
    if (standing.bias <= left_in_the_end) return std::nullopt;
    return std::fmax(cautious_factor * state_.stage_error, RenderLimits::smallest_error);
  }
  if (standing.bias <= bias_share * settings_.error) return std::nullopt;
  // The estimate is what counts, not what the stage aimed at; but a bias that doesn't fall won't.
  if (state_.last_bias > 0 && standing.bias > worthwhile * state_.last_bias) {
    state_.prepares = false;
    return std::nullopt;
  }
  state_.last_bias = standing.bias;
  const double factor =
      std::clamp(bias_share * bias_share * settings_.error / standing.bias, stage_factor, cautious_factor);
  state_.aim = std::fmax(factor * state_.stage_error, RenderLimits::smallest_error);
  return state_.aim;
}

std::optional<Step> Progression::first_steps(const Standing& standing) {
  if (state_.stages > 0 || !state_.prepares) return std::nullopt;
  // Who makes no records reads them as finely as the picture is to be at once: no stage can follow.
  const bool reads_only = settings_.integrator_settings.most_records == 0;
  return prepare(reads_only ? state_.aim : std::fmax(preview_error, state_.aim), true, standing);
}

Step Progression::next(const Standing& standing) {
  if (settings_.fill_only)
    return state_.stages == 0 && state_.prepares ? prepare(state_.aim, false, standing) : Step{};
  if (const std::optional<Step> first = first_steps(standing)) return *first;
  // Every stage is shown by a sample, if there are enough of them.
  const bool more_than_one = standing.samples + 1 < static_cast<uint32_t>(settings_.samples_per_pixel);
  if (state_.begin_with_pass && more_than_one) {
    state_.begin_with_pass = false;
    state_.decision_at = standing.samples + 1;
    state_.cached_until = no_limit;
    return pass(standing);
  }
  if (standing.samples >= state_.decision_at || settings_.time_budget_seconds > 0) {
    if (good_enough(standing)) return {};
    if (const std::optional<double> error = finer_target(standing)) return prepare(*error, false, standing);
    state_.decision_at =
        standing.samples +
        std::max(1u, static_cast<uint32_t>(looks_apart * static_cast<double>(standing.samples)));
    if (settings_.error == 0) state_.decision_at = 0;
    look(standing);
  }
  return pass(standing);
}

}  // namespace fogbank::render
