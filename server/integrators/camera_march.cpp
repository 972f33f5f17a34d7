#include "integrators/camera_march.h"

#include <algorithm>
#include <cmath>

namespace fogbank::integrators {

namespace {

constexpr size_t bundle = cache::packet_size;
/// Steps, in radii of the records around. Linear interpolation over h errs by h^2/8 where a record's
/// extrapolation errs by R^2/2 at its border: 1/16 of it.
constexpr float step_share = 0.5f;
/// Steps grow as what is behind is hidden: their error counts by the transmittance, and goes with their
/// square. At most by this factor.
constexpr float most_growth = 4.0f;
/// Nodes end where transmittance falls below exp(-this); the last one's radiance stands for the rest.
constexpr float most_optical_distance = 9.0f;
/// Widest gap between records that those at its ends answer for, in their radii: farther apart than that two
/// records that cover a ray leave no gap. Linear interpolation across it errs as much as one of them does at
/// its border, at most; gaps get narrower as extents do.
constexpr float widest_gap = 1.0f;
/// Left over when steps stop adapting, so that the end is always reached.
constexpr size_t reserve = 2 * bundle;

/// Of the channels that scatter; infinite where none does.
float least_sigma(const transport::MediumInfo& medium) {
  float least = infinity;
  for (int channel = 0; channel < 3; ++channel)
    if (medium.sigma_s[channel] > 0) least = std::fmin(least, medium.sigma_t[channel]);
  return least;
}

}  // namespace

StepWeights step_weights(float x) {
  if (x < 0.5f) {
    // Taylor series: the closed form loses digits.
    const float near =
        1.0f / 2 - x * (1.0f / 6 - x * (1.0f / 24 -
                                        x * (1.0f / 120 - x * (1.0f / 720 - x * (1.0f / 5040 - x / 40320)))));
    const float far =
        1.0f / 2 -
        x * (1.0f / 3 - x * (1.0f / 8 - x * (1.0f / 30 - x * (1.0f / 144 - x * (1.0f / 840 - x / 5760)))));
    return {near, far};
  }
  const float through = std::exp(-x);
  const float inverse = 1 / x;
  return {(x - 1 + through) * inverse * inverse, (1 - through * (1 + x)) * inverse * inverse};
}

MarchSample sample_distance(const transport::MediumSegment& segment, float first, float last,
                            RandomStream& random) {
  const transport::MediumInfo& medium = *segment.medium;
  const float u_channel = random.next_float();
  const float u = random.next_float();
  const Vec3f& weights = segment.channel_weights;
  const int chosen = u_channel < weights.x ? 0 : u_channel < weights.x + weights.y ? 1 : 2;
  const auto share = [&](int channel) { return -std::expm1(-medium.sigma_t[channel] * (last - first)); };
  if (!(share(chosen) > 0)) return {};
  const float along = -std::log1p(-u * share(chosen)) / medium.sigma_t[chosen];
  float pdf = 0;
  for (int channel = 0; channel < 3; ++channel) {
    const float sigma = medium.sigma_t[channel];
    if (share(channel) > 0) pdf += weights[channel] * sigma * std::exp(-sigma * along) / share(channel);
  }
  if (!(pdf > 0)) return {};
  const float t = std::fmin(first + along, last);
  return {t, medium.sigma_s * transport::transmittance(medium.sigma_t, t) / pdf};
}

std::optional<cache::ScatteredDirection> scattered_direction(const transport::MediumSegment& segment) {
  const transport::PhaseFunction& phase = segment.medium->phase;
  if (phase.is_isotropic()) return std::nullopt;
  return cache::ScatteredDirection(phase, segment.direction);
}

CameraMarch::CameraMarch(const transport::MediumSegment& segment, float first, float last,
                         const cache::Index* index, const cache::VisibilityTest& visibility,
                         float widest_step)
    : segment_(segment), scattered_(scattered_direction(segment)), first_(first), last_(last) {
  const transport::MediumInfo& medium = *segment.medium;
  const float hidden = most_optical_distance / least_sigma(medium);
  if (!(first < last) || !(first < hidden)) return;
  last_ = std::fmin(last, hidden);
  place_nodes(index, visibility, widest_step);
  bridge_gaps();
  weigh();
  if (last > hidden) {
    for (int channel = 0; channel < 3; ++channel)
      if (medium.sigma_s[channel] > 0)
        tail_[channel] = medium.albedo[channel] * transmittance_at(hidden)[channel];
    nodes_[count_ - 1].weight += tail_;
  }
}

Spectrum CameraMarch::transmittance_at(float t) const {
  return transport::transmittance(segment_.medium->sigma_t, t);
}

void CameraMarch::place_nodes(const cache::Index* index, const cache::VisibilityTest& visibility,
                              float widest_step) {
  const float sigma = segment_.medium->mean_sigma_t;
  const auto wanted_step = [&](const MarchNode& node) {
    const float step = node.found.weight > 0 ? step_share * node.found.radius : widest_step;
    return step * std::fmin(std::exp(0.5f * sigma * (node.t - first_)), most_growth);
  };
  float step = widest_step;
  bool adaptive = index != nullptr;
  while (count_ == 0 || nodes_[count_ - 1].t < last_) {
    const float begin = count_ == 0 ? first_ : nodes_[count_ - 1].t;
    const size_t left = most_nodes - count_;
    const float steps = std::ceil((last_ - begin) / step);
    if (left <= reserve || !(steps < static_cast<float>(left))) {
      // Whatever they want: evenly, as far as they go.
      if (left <= reserve || !adaptive) {
        step = (last_ - begin) / static_cast<float>(left - 1);
        adaptive = false;
      }
    } else if (steps <= static_cast<float>(bundle)) {
      step = (last_ - begin) / steps;
    }
    std::array<Vec3f, bundle> points;
    std::array<cache::Interpolation, bundle> found{};
    std::array<float, bundle> distances{};
    size_t size = 0;
    for (; size < std::min(bundle, left); ++size) {
      const float along = static_cast<float>(size + (count_ == 0 ? 0 : 1)) * step;
      // The last step ends where the segment does, to the bit.
      const float t = begin + along < last_ - 0.5f * step ? begin + along : last_;
      distances[size] = t;
      points[size] = segment_.origin + segment_.direction * t;
      if (t == last_) {
        ++size;
        break;
      }
    }
    if (index != nullptr) index->look_up(std::span(points).first(size), found, scattered());
    float next = step;
    for (size_t i = 0; i < size; ++i) {
      if (index != nullptr) index->recover_visible(points[i], Vec3f(0), visibility, found[i], scattered());
      MarchNode& node = nodes_[count_++];
      node = {distances[i], found[i], found[i].radiance, found[i].weight > 0};
      next = wanted_step(node);
      if (adaptive && step > 2 * next) break;
    }
    if (adaptive) step = next;
  }
}

void CameraMarch::bridge_gaps() {
  for (size_t begin = 1, end = 1; begin < count_; begin = end + 1) {
    bool hidden = false;  // by a surface between
    for (end = begin; end < count_ && !nodes_[end].known; ++end)
      hidden = hidden || nodes_[end].found.rejected > 0;
    const MarchNode& before = nodes_[begin - 1];
    if (begin == end || end == count_ || hidden || !before.known) continue;
    const MarchNode& after = nodes_[end];
    const float gap = after.t - before.t;
    if (gap > widest_gap * std::fmin(before.found.radius, after.found.radius)) continue;
    for (size_t i = begin; i < end; ++i) {
      nodes_[i].radiance = glm::mix(before.radiance, after.radiance, (nodes_[i].t - before.t) / gap);
      nodes_[i].known = true;
    }
  }
}

void CameraMarch::weigh() {
  const transport::MediumInfo& medium = *segment_.medium;
  const Spectrum& sigma_t = medium.sigma_t;
  Spectrum through = transmittance_at(nodes_[0].t);
  for (size_t i = 0; i + 1 < count_; ++i) {
    const float step = nodes_[i + 1].t - nodes_[i].t;
    const Spectrum scale = medium.sigma_s * through * step;
    if (medium.grey) {
      const StepWeights weights = step_weights(sigma_t.x * step);
      nodes_[i].weight += scale * weights.near;
      nodes_[i + 1].weight += scale * weights.far;
    } else {
      for (int channel = 0; channel < 3; ++channel) {
        const StepWeights weights = step_weights(sigma_t[channel] * step);
        nodes_[i].weight[channel] += scale[channel] * weights.near;
        nodes_[i + 1].weight[channel] += scale[channel] * weights.far;
      }
    }
    through = transmittance_at(nodes_[i + 1].t);
  }
}

MarchSample CameraMarch::sample_around(size_t number, RandomStream& random) const {
  const MarchNode& node = nodes_[number];
  const Spectrum& sigma_s = segment_.medium->sigma_s;
  const float u = random.next_float();
  if (number + 1 == count_ && !is_black(tail_)) {
    const float probability = mean(tail_) / mean(node.weight);
    if (random.next_float() < probability) {
      const float sigma = least_sigma(*segment_.medium);
      const float beyond = -std::log1p(-u) / sigma;
      const float pdf = sigma * std::exp(-sigma * beyond) * probability;
      return {node.t + beyond, sigma_s * transmittance_at(node.t + beyond) / pdf};
    }
    MarchSample sample = sample_hat(number, u);
    sample.weight /= 1 - probability;
    return sample;
  }
  return sample_hat(number, u);
}

MarchSample CameraMarch::sample_hat(size_t number, float u) const {
  const float middle = nodes_[number].t;
  const float below = number > 0 ? nodes_[number - 1].t : middle;
  const float above = number + 1 < count_ ? nodes_[number + 1].t : middle;
  const float t = below + u * (above - below);
  const float hat = t < middle       ? (t - below) / (middle - below)
                    : above > middle ? (above - t) / (above - middle)
                                     : 1.0f;
  return {t, segment_.medium->sigma_s * transmittance_at(t) * (hat * (above - below))};
}

}  // namespace fogbank::integrators
