#include "transport/emission_guide.h"

#include <algorithm>
#include <cmath>

namespace fogbank::transport {

namespace {

/// Share of the paths that are drawn uniformly: no path's weight is more than 1 / uniform_share times what it
/// would be without a guide, however wrong the guide.
constexpr float uniform_share = 0.2f;
/// Trials of middling importance that a box is thought to have had in each half besides its own: a half
/// where few trials found nothing isn't ruled out.
constexpr double prior_trials = 4;
/// A box with fewer trials of any importance, or with less than this share of all importance, stays whole.
constexpr size_t least_trials = 300;
constexpr double least_mass = 1.0 / 1024;
/// No side of a box is shorter.
constexpr float least_side = 0x1p-12f;

double mass_of(std::span<const EmissionTrial> trials) {
  double mass = 0;
  for (const EmissionTrial& trial : trials) mass += static_cast<double>(trial.importance);
  return mass;
}

}  // namespace

EmissionGuide::EmissionGuide() : EmissionGuide(std::span<const EmissionTrial>{}) {}

EmissionGuide::EmissionGuide(std::span<const EmissionTrial> trials) {
  std::vector<EmissionTrial> important;
  for (const EmissionTrial& trial : trials) {
    if (trial.importance > 0) important.push_back(trial);
  }
  const double total = mass_of(important);
  Box whole;
  whole.size.fill(1);
  whole.probability = 1;
  split(important, whole, least_mass * total);
  cumulative_.push_back(0);
  double sum = 0;
  for (Box& box : boxes_) {
    float volume = 1;
    for (const float side : box.size) volume *= side;
    box.probability = uniform_share * volume + (1 - uniform_share) * box.probability;
    sum += static_cast<double>(box.probability);
    cumulative_.push_back(static_cast<float>(sum));
  }
  for (float& value : cumulative_) value /= static_cast<float>(sum);
  for (Box& box : boxes_) box.probability /= static_cast<float>(sum);
}

void EmissionGuide::split(std::span<EmissionTrial> trials, const Box& box, double mass_of_split) {
  const double mass = mass_of(trials);
  // The dimension whose two halves differ most; among those that are alike the longest side.
  size_t dimension = emission_dimensions;
  double most = -1;
  if (trials.size() >= least_trials && mass > mass_of_split) {
    for (size_t i = 0; i < emission_dimensions; ++i) {
      if (box.size[i] <= least_side) continue;
      const float middle = box.lower[i] + 0.5f * box.size[i];
      double below = 0;
      for (const EmissionTrial& trial : trials) {
        if (trial.point[i] < middle) below += static_cast<double>(trial.importance);
      }
      const double contrast = std::fabs(2 * below - mass) / mass + 0.05 * static_cast<double>(box.size[i]);
      if (contrast > most) {
        most = contrast;
        dimension = i;
      }
    }
  }
  if (dimension == emission_dimensions) {
    boxes_.push_back(box);
    return;
  }
  Box lower = box;
  lower.size[dimension] *= 0.5f;
  Box upper = lower;
  upper.lower[dimension] += lower.size[dimension];
  const float middle = upper.lower[dimension];
  const auto end = std::stable_partition(trials.begin(), trials.end(), [&](const EmissionTrial& trial) {
    return trial.point[dimension] < middle;
  });
  const auto count = static_cast<size_t>(end - trials.begin());
  const double prior = prior_trials * mass / static_cast<double>(trials.size());
  const double share = (mass_of(trials.first(count)) + prior) / (mass + 2 * prior);
  lower.probability = box.probability * static_cast<float>(share);
  upper.probability = box.probability * static_cast<float>(1 - share);
  split(trials.first(count), lower, mass_of_split);
  split(trials.subspan(count), upper, mass_of_split);
}

EmissionGuide::Sample EmissionGuide::sample(float u_box, RandomStream& random) const {
  const auto above = std::upper_bound(cumulative_.begin(), cumulative_.end(), u_box);
  const auto index = static_cast<size_t>(std::clamp<std::ptrdiff_t>(
      above - cumulative_.begin() - 1, 0, static_cast<std::ptrdiff_t>(boxes_.size()) - 1));
  const Box& box = boxes_[index];
  Sample sample;
  // As drawn, rounding of the cumulative sums included.
  sample.pdf = cumulative_[index + 1] - cumulative_[index];
  for (size_t i = 0; i < emission_dimensions; ++i) {
    sample.point[i] = std::fmin(box.lower[i] + box.size[i] * random.next_float(), one_minus_epsilon);
    sample.pdf /= box.size[i];
  }
  return sample;
}

}  // namespace fogbank::transport
