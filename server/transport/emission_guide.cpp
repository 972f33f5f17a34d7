#include "transport/emission_guide.h"

#include <algorithm>
#include <cmath>

namespace fogbank::transport {

namespace {

/// Share of the paths that are drawn uniformly: no path's weight is more than 1 / uniform_share times what it
/// would be without a guide, however wrong the guide.
constexpr double uniform_share = 0.2f;
/// Trials of middling importance that a box is thought to have had in each half besides its own: a half
/// where few trials found nothing isn't ruled out.
constexpr double prior_trials = 4;
/// A box with fewer trials of any importance, or with less than this share of all squares, stays whole.
constexpr size_t least_trials = 300;
constexpr double least_moment = 1.0 / 4096;
/// More edges than these aren't heeded: each makes a box.
constexpr size_t most_edges = 65;
/// No side of a box is shorter.
constexpr float least_side = 0x1p-12f;

double square_of(const EmissionTrial& trial) {
  return sqr(static_cast<double>(trial.importance)) * static_cast<double>(trial.pdf);
}

double moment_of(std::span<const EmissionTrial> trials) {
  double moment = 0;
  for (const EmissionTrial& trial : trials) moment += square_of(trial);
  return moment;
}

}  // namespace

double EmissionGuide::Box::volume() const {
  double volume = 1;
  for (const float side : size) volume *= static_cast<double>(side);
  return volume;
}

EmissionGuide::EmissionGuide() : EmissionGuide({}, {}) {}

EmissionGuide::EmissionGuide(std::span<const EmissionTrial> trials, std::span<const float> edges) {
  std::vector<EmissionTrial> important;
  for (const EmissionTrial& trial : trials) {
    if (trial.importance > 0) important.push_back(trial);
  }
  const double total = moment_of(important);
  Box box;
  box.size.fill(1);
  if (edges.size() < 2 || edges.size() > most_edges) {
    box.moment = total;
    split(important, box, 0, least_moment * total);
  } else {
    const double prior = important.empty() ? 0 : prior_trials * total / static_cast<double>(important.size());
    auto rest = important.begin();
    for (size_t i = 0; i + 1 < edges.size(); ++i) {
      box.lower[0] = edges[i];
      box.size[0] = edges[i + 1] - edges[i];
      const auto end = std::stable_partition(
          rest, important.end(), [&](const EmissionTrial& trial) { return trial.point[0] < edges[i + 1]; });
      const std::span<EmissionTrial> part(rest, end);
      box.moment = moment_of(part) + prior;
      split(part, box, 1, least_moment * total);
      rest = end;
    }
  }
  double mass = 0;
  for (const Box& leaf : boxes_) mass += std::sqrt(leaf.volume() * leaf.moment);
  cumulative_.push_back(0);
  double sum = 0;
  for (const Box& leaf : boxes_) {
    const double volume = leaf.volume();
    sum += mass > 0 ? uniform_share * volume + (1 - uniform_share) * std::sqrt(volume * leaf.moment) / mass
                    : volume;
    cumulative_.push_back(static_cast<float>(sum));
  }
  for (float& value : cumulative_) value /= static_cast<float>(sum);
}

void EmissionGuide::split(std::span<EmissionTrial> trials, const Box& box, size_t first_dimension,
                          double moment_of_split) {
  const double moment = moment_of(trials);
  // The dimension whose two halves differ most; among those that are alike the longest side.
  size_t dimension = emission_dimensions;
  double most = -1;
  if (trials.size() >= least_trials && moment > moment_of_split) {
    for (size_t i = first_dimension; i < emission_dimensions; ++i) {
      if (box.size[i] <= least_side) continue;
      const float middle = box.lower[i] + 0.5f * box.size[i];
      double below = 0;
      for (const EmissionTrial& trial : trials) {
        if (trial.point[i] < middle) below += square_of(trial);
      }
      const double contrast =
          std::fabs(2 * below - moment) / moment + 0.05 * static_cast<double>(box.size[i]);
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
  const double prior = prior_trials * moment / static_cast<double>(trials.size());
  const double share = (moment_of(trials.first(count)) + prior) / (moment + 2 * prior);
  lower.moment = box.moment * share;
  upper.moment = box.moment * (1 - share);
  split(trials.first(count), lower, first_dimension, moment_of_split);
  split(trials.subspan(count), upper, first_dimension, moment_of_split);
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
