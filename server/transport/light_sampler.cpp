#include "transport/light_sampler.h"

#include <algorithm>
#include <array>
#include <string>

#include "core/error.h"
#include "core/fast_math.h"
namespace fogbank::transport {

namespace {

/// Part of the choice among the lights at infinity and the tree (or its lights, where it is a single leaf)
/// that doesn't follow their importance.
constexpr float even_share = 0.1f;
/// Optical distances count for choosing lights only up to here: the proxy knows neither holes nor the end of
/// the fog.
constexpr float most_optical_distance = 4.0f;

/// cos(max(0, a - b)) of angles given by their sines and cosines.
float cos_of_difference_clamped(float sin_a, float cos_a, float sin_b, float cos_b) {
  return cos_a > cos_b ? 1.0f : cos_a * cos_b + sin_a * sin_b;
}
float sin_of_difference_clamped(float sin_a, float cos_a, float sin_b, float cos_b) {
  return cos_a > cos_b ? 0.0f : sin_a * cos_b - cos_a * sin_b;
}

/// Largest cosine, over directions to a sphere (center direction `w`, half angle b), with `normal`.
float receiver_cosine(const Vec3f& normal, const Vec3f& w, float sin_b, float cos_b) {
  const float cosine = std::clamp(glm::dot(normal, w), -1.0f, 1.0f);
  return cos_of_difference_clamped(safe_sqrt(1 - cosine * cosine), cosine, sin_b, cos_b);
}

/// Upper-bound-like importance of lights within `bounds` at a receiver.
float bounds_importance(const LightReceiver& receiver, const LightBounds& bounds) {
  const Vec3f towards = bounds.center - receiver.position;
  const float distance_squared = glm::dot(towards, towards);
  const float near_squared = std::fmax(distance_squared, sqr(bounds.radius));
  float importance = bounds.intensity / std::fmax(near_squared, std::numeric_limits<float>::min());
  const float distance = std::sqrt(distance_squared);
  if (distance > bounds.radius) {
    const Vec3f w = towards / distance;
    const float sin_b = bounds.radius / distance;
    const float cos_b = safe_sqrt(1 - sin_b * sin_b);
    if (bounds.cos_spread > -1) {
      // Angle between the axis and the direction to the receiver, less the spread, less the sphere's half
      // angle.
      const float cos_w = std::clamp(glm::dot(bounds.axis, -w), -1.0f, 1.0f);
      const float sin_w = safe_sqrt(1 - cos_w * cos_w);
      const float sin_spread = safe_sqrt(1 - sqr(bounds.cos_spread));
      const float cos_x = cos_of_difference_clamped(sin_w, cos_w, sin_spread, bounds.cos_spread);
      const float sin_x = sin_of_difference_clamped(sin_w, cos_w, sin_spread, bounds.cos_spread);
      const float cos_emitted = cos_of_difference_clamped(sin_x, cos_x, sin_b, cos_b);
      if (cos_emitted <= bounds.cos_emission) return 0;
      importance *= std::fmax(cos_emitted, 0.0f) + 1e-3f;
    }
    if (receiver.normal != Vec3f(0)) {
      const float cosine = receiver_cosine(receiver.normal, w, sin_b, cos_b);
      if (cosine <= 0) return 0;
      importance *= cosine;
    }
  }
  return importance *
         fast_exp_negative(-std::fmin(receiver.mean_sigma_t * std::fmax(distance - bounds.radius, 0.0f),
                                      most_optical_distance));
}

float light_importance(const LightReceiver& receiver, const Light& light) {
  float importance = light.fluence(receiver.position);
  if (importance == 0) return 0;
  const Vec3f w = light.direction_from(receiver.position);
  if (light.at_infinity()) {
    // The mean cosine over a hemisphere of a light without a direction is 1/4 of its fluence.
    if (receiver.normal != Vec3f(0))
      importance *= w == Vec3f(0) ? 0.25f : std::fmax(glm::dot(receiver.normal, w), 0.0f);
    return importance;
  }
  const LightBounds& bounds = light.bounds();
  const float distance = glm::length(bounds.center - receiver.position);
  if (receiver.normal != Vec3f(0) && distance > bounds.radius) {
    const float sin_b = bounds.radius / distance;
    importance *= std::fmax(receiver_cosine(receiver.normal, w, sin_b, safe_sqrt(1 - sin_b * sin_b)), 0.0f);
  }
  return importance *
         fast_exp_negative(-std::fmin(receiver.mean_sigma_t * std::fmax(distance - bounds.radius, 0.0f),
                                      most_optical_distance));
}

/// Closed form of the integral of 1 / distance^2 along the segment, (angle subtended) / height, with the
/// height kept above the bounds' radius, times transmittance at the nearest point.
float along_segment(const MediumSegment& segment, const LightBounds& bounds) {
  const Vec3f to_center = bounds.center - segment.origin;
  const float nearest = glm::dot(to_center, segment.direction);
  const float height = std::fmax(glm::length(to_center - segment.direction * nearest),
                                 std::fmax(bounds.radius, 1e-6f * std::fabs(nearest)));
  const float sigma = segment.medium->mean_sigma_t;
  // In thick media only the first few free paths count.
  const float end = sigma > 0 ? std::fmin(segment.length, 4 / sigma) : segment.length;
  const float angle = fast_atan((end - nearest) / height) + fast_atan(nearest / height);
  const float t = std::clamp(nearest, 0.0f, end);
  const Vec3f offset = to_center - segment.direction * t;
  const float distance = glm::length(offset);
  float to_light = std::fmax(distance - bounds.radius, 0.0f);
  // A light outside the medium shines through clear air up to the medium's box.
  if (to_light > 0)
    to_light = std::fmin(to_light, segment.medium->extent.exit_distance(
                                       segment.origin + segment.direction * t, offset / distance));
  return std::fmax(angle, 1e-7f) / std::fmax(height, std::numeric_limits<float>::min()) *
         std::exp(-std::fmin(sigma * (t + to_light), 2 * most_optical_distance));
}

float bounds_importance(const MediumSegment& segment, const LightBounds& bounds) {
  return bounds.intensity * along_segment(segment, bounds);
}

float light_importance(const MediumSegment& segment, const Light& light) {
  const float sigma = segment.medium->mean_sigma_t;
  const float end = sigma > 0 ? std::fmin(segment.length, 16 / sigma) : segment.length;
  if (!std::isfinite(end)) return 0;
  if (light.at_infinity()) {
    // One node at the middle of what transmittance lets through.
    const float opacity = 1 - fast_exp_negative(-sigma * end);
    const float middle = opacity > 1e-3f ? -std::log(1 - 0.5f * opacity) / sigma : 0.5f * end;
    float importance = 0;
    segment_importance(segment, light, &middle, 1, &importance);
    return importance * end;
  }
  // Three nodes decide what the light's orientation lets through; 0 only when it faces away from both ends,
  // and the bounds' closed form supplies the peak near the light.
  const LightBounds& bounds = light.bounds();
  const float nearest = std::clamp(glm::dot(bounds.center - segment.origin, segment.direction), 0.0f, end);
  // Eight, because that is one vector register; the rest repeat the end.
  constexpr int lanes = 8;
  std::array<float, lanes> t{};
  t.fill(end);
  t[0] = 0;
  t[1] = nearest;
  std::array<float, lanes> fluence{};
  light.fluence_along(segment.origin, segment.direction, t.data(), lanes, fluence.data());
  float share = 0;
  for (size_t i = 0; i < 3; ++i) {
    const Vec3f d = bounds.center - (segment.origin + segment.direction * t[i]);
    const float isotropic =
        bounds.intensity / std::fmax(glm::dot(d, d), sqr(bounds.radius) + std::numeric_limits<float>::min());
    share += std::fmin(fluence[i] / isotropic, 1.0f);
  }
  if (share == 0) return 0;
  const Vec3f towards = light.direction_from(segment.origin + segment.direction * nearest);
  float phase = 1;
  if (!segment.medium->phase.is_isotropic() && towards != Vec3f(0))
    phase = 0.25f + 4 * pi * segment.medium->phase.evaluate(segment.direction, towards);
  return bounds.intensity * along_segment(segment, bounds) * (share / 3 + 0.02f) * phase *
         glm::dot(segment.channel_weights, segment.medium->sigma_s);
}

/// Smallest sphere around two spheres, and a cone around two cones.
LightBounds merge(const LightBounds& a, const LightBounds& b) {
  LightBounds merged;
  merged.intensity = a.intensity + b.intensity;
  const Vec3f between = b.center - a.center;
  const float distance = glm::length(between);
  if (distance + b.radius <= a.radius) {
    merged.center = a.center;
    merged.radius = a.radius;
  } else if (distance + a.radius <= b.radius) {
    merged.center = b.center;
    merged.radius = b.radius;
  } else {
    merged.radius = 0.5f * (distance + a.radius + b.radius);
    merged.center = a.center + between * ((merged.radius - a.radius) / distance);
    // Rounding must not leave a child outside.
    merged.radius *= 1 + 1e-5f;
  }
  merged.cos_emission = std::fmin(a.cos_emission, b.cos_emission);
  if (a.cos_spread <= -1 || b.cos_spread <= -1) {
    merged.cos_spread = -1;
    return merged;
  }
  const float angle_a = std::acos(std::clamp(a.cos_spread, -1.0f, 1.0f));
  const float angle_b = std::acos(std::clamp(b.cos_spread, -1.0f, 1.0f));
  const float between_axes = std::acos(std::clamp(glm::dot(a.axis, b.axis), -1.0f, 1.0f));
  if (between_axes + angle_b <= angle_a) {
    merged.axis = a.axis;
    merged.cos_spread = a.cos_spread;
    return merged;
  }
  if (between_axes + angle_a <= angle_b) {
    merged.axis = b.axis;
    merged.cos_spread = b.cos_spread;
    return merged;
  }
  const float spread = 0.5f * (angle_a + between_axes + angle_b) + 1e-4f;
  const Vec3f rotation = glm::cross(a.axis, b.axis);
  const float sine = glm::length(rotation);
  if (spread >= pi || !(sine > 1e-6f)) {
    merged.cos_spread = -1;
    return merged;
  }
  const float turn = spread - angle_a;
  const Vec3f across = glm::cross(rotation / sine, a.axis);
  merged.axis = glm::normalize(a.axis * std::cos(turn) + across * std::sin(turn));
  merged.cos_spread = std::cos(spread);
  return merged;
}

/// Draws an index in proportion to `weights` and rescales `u`.
size_t pick(const float* weights, size_t count, float total, float& u) {
  float target = u * total;
  size_t last = 0;
  for (size_t i = 0; i < count; ++i) {
    if (weights[i] == 0) continue;
    last = i;
    if (target < weights[i]) {
      u = std::fmin(target / weights[i], one_minus_epsilon);
      return i;
    }
    target -= weights[i];
  }
  u = one_minus_epsilon;
  return last;
}

}  // namespace

LightSampler::LightSampler(std::vector<LightPointer> lights)
    : lights_(std::move(lights)), trails_(lights_.size(), 0) {
  for (uint32_t i = 0; i < lights_.size(); ++i) (lights_[i]->at_infinity() ? infinite_ : order_).push_back(i);
  for (const uint32_t index : infinite_)
    if (lights_[index]->is_delta()) parallel_.push_back(index);
  if (parallel_.size() > most_parallel_lights) parallel_.clear();
  if (infinite_.size() > most_infinite_lights)
    throw Error(ErrorKind::resource_exhausted, "TOO_MANY_INFINITE_LIGHTS",
                "the scene has " + std::to_string(infinite_.size()) + " lights at infinity; at most " +
                    std::to_string(most_infinite_lights) + " are supported");
  if (!order_.empty()) {
    nodes_.reserve(2 * order_.size());
    build(0, static_cast<uint32_t>(order_.size()), 0, 0);
  }
}

uint32_t LightSampler::build(uint32_t first, uint32_t count, uint32_t depth, uint64_t trail) {
  const auto index = static_cast<uint32_t>(nodes_.size());
  nodes_.emplace_back();
  if (count <= leaf_size) {
    LightBounds bounds = lights_[order_[first]]->bounds();
    for (uint32_t i = first; i < first + count; ++i) {
      if (i > first) bounds = merge(bounds, lights_[order_[i]]->bounds());
      trails_[order_[i]] = trail;
    }
    nodes_[index] = {bounds, first, count};
    return index;
  }
  // Median split along the widest axis of the centres; ties by index keep the order the same everywhere.
  Vec3f lower(infinity);
  Vec3f upper(-infinity);
  for (uint32_t i = first; i < first + count; ++i) {
    lower = glm::min(lower, lights_[order_[i]]->bounds().center);
    upper = glm::max(upper, lights_[order_[i]]->bounds().center);
  }
  const Vec3f size = upper - lower;
  const int axis = size.x >= size.y && size.x >= size.z ? 0 : (size.y >= size.z ? 1 : 2);
  const uint32_t half = count / 2;
  std::nth_element(order_.begin() + first, order_.begin() + first + half, order_.begin() + first + count,
                   [&](uint32_t a, uint32_t b) {
                     const float ca = lights_[a]->bounds().center[axis];
                     const float cb = lights_[b]->bounds().center[axis];
                     return ca != cb ? ca < cb : a < b;
                   });
  const uint32_t left = build(first, half, depth + 1, trail);
  const uint32_t right = build(first + half, count - half, depth + 1, trail | (uint64_t{1} << depth));
  nodes_[index] = {merge(nodes_[left].bounds, nodes_[right].bounds), right, 0};
  return index;
}

template <typename Place>
LightSampler::Top LightSampler::top_of(const Place& place, LightSubset subset) const {
  Top top;
  const bool without_parallel = subset == LightSubset::besides_parallel && !parallel_.empty();
  const auto add = [&top](float importance) { top.total += top.weights[top.count++] = importance; };
  const size_t finite = is_flat() ? order_.size() : 1;
  if (infinite_.size() + finite == 1 && is_flat()) {
    // The only light there is: nothing to weigh.
    add(without_parallel ? 0 : 1);
    return top;
  }
  for (const uint32_t index : infinite_) {
    const Light& light = *lights_[index];
    add(without_parallel && light.is_delta() ? 0 : light_importance(place, light));
  }
  if (is_flat()) {
    for (const uint32_t index : order_) add(light_importance(place, *lights_[index]));
  } else {
    add(bounds_importance(place, nodes_[0].bounds));
  }
  if (!std::isfinite(top.total)) top.total = 0;
  // Proxies know nothing of occlusion: a light that seems weak beside a hidden strong one still gets a share.
  if (top.count == 0) return top;
  const float even = even_share * top.total / static_cast<float>(top.count);
  for (size_t i = 0; i < top.count; ++i) {
    if (top.weights[i] == 0) continue;
    top.weights[i] += even;
    top.total += even;
  }
  return top;
}

template <typename Place>
std::optional<LightChoice> LightSampler::choose_from(const Top& top, const Place& place, float& u) const {
  if (!(top.total > 0)) return std::nullopt;
  const size_t chosen = pick(top.weights.data(), top.count, top.total, u);
  float probability = top.weights[chosen] / top.total;
  if (chosen < infinite_.size()) return LightChoice{infinite_[chosen], probability};
  if (is_flat()) return LightChoice{order_[chosen - infinite_.size()], probability};
  const Node* node = nodes_.data();
  while (node->count == 0) {
    const Node* left = node + 1;
    const Node* right = nodes_.data() + node->first;
    const std::array<float, 2> weights{bounds_importance(place, left->bounds),
                                       bounds_importance(place, right->bounds)};
    const float sum = weights[0] + weights[1];
    if (!(sum > 0)) return std::nullopt;
    const size_t side = pick(weights.data(), 2, sum, u);
    probability *= weights[side] / sum;
    node = side == 0 ? left : right;
  }
  std::array<float, leaf_size> weights{};
  float sum = 0;
  for (uint32_t i = 0; i < node->count; ++i)
    sum += weights[i] = light_importance(place, *lights_[order_[node->first + i]]);
  if (!(sum > 0)) return std::nullopt;
  const size_t within = pick(weights.data(), node->count, sum, u);
  return LightChoice{order_[node->first + within], probability * weights[within] / sum};
}

template <typename Place>
float LightSampler::probability_at(const Place& place, uint32_t light, LightSubset subset) const {
  const Top top = top_of(place, subset);
  if (!(top.total > 0)) return 0;
  if (lights_[light]->at_infinity()) {
    for (size_t i = 0; i < infinite_.size(); ++i)
      if (infinite_[i] == light) return top.weights[i] / top.total;
    return 0;
  }
  if (is_flat()) {
    for (size_t i = 0; i < order_.size(); ++i)
      if (order_[i] == light) return top.weights[infinite_.size() + i] / top.total;
    return 0;
  }
  float probability = top.weights[infinite_.size()] / top.total;
  const Node* node = nodes_.data();
  uint64_t trail = trails_[light];
  while (node->count == 0) {
    const Node* left = node + 1;
    const Node* right = nodes_.data() + node->first;
    const float weight_left = bounds_importance(place, left->bounds);
    const float weight_right = bounds_importance(place, right->bounds);
    const float sum = weight_left + weight_right;
    if (!(sum > 0)) return 0;
    probability *= ((trail & 1) != 0 ? weight_right : weight_left) / sum;
    node = (trail & 1) != 0 ? right : left;
    trail >>= 1;
  }
  float sum = 0;
  float own = 0;
  for (uint32_t i = 0; i < node->count; ++i) {
    const uint32_t index = order_[node->first + i];
    const float weight = light_importance(place, *lights_[index]);
    sum += weight;
    if (index == light) own = weight;
  }
  return sum > 0 ? probability * own / sum : 0;
}

template <typename Place>
void LightSampler::choose_all(const Place& place, LightSubset subset, std::span<float> u,
                              std::span<LightChoice> choices) const {
  const Top top = top_of(place, subset);
  for (size_t i = 0; i < u.size(); ++i) choices[i] = choose_from(top, place, u[i]).value_or(LightChoice{});
}

std::optional<LightChoice> LightSampler::choose(const LightReceiver& receiver, float& u) const {
  return choose_from(top_of(receiver), receiver, u);
}
float LightSampler::probability(const LightReceiver& receiver, uint32_t light, LightSubset subset) const {
  return probability_at(receiver, light, subset);
}
std::optional<LightChoice> LightSampler::choose(const MediumSegment& segment, float& u) const {
  return choose_from(top_of(segment), segment, u);
}
void LightSampler::choose(const LightReceiver& receiver, LightSubset subset, std::span<float> u,
                          std::span<LightChoice> choices) const {
  choose_all(receiver, subset, u, choices);
}
void LightSampler::choose(const MediumSegment& segment, LightSubset subset, std::span<float> u,
                          std::span<LightChoice> choices) const {
  choose_all(segment, subset, u, choices);
}
float LightSampler::probability(const MediumSegment& segment, uint32_t light) const {
  return probability_at(segment, light, LightSubset::all);
}

}  // namespace fogbank::transport
