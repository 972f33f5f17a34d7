#include "transport/distance_table.h"

#include <algorithm>

#include "core/fast_math.h"

namespace fogbank::transport {

namespace {

/// Nodes by angle seen from the light (they crowd where a near light peaks) and by transmittance (they crowd
/// near the origin in thick media). Ends are shared.
struct NodeCounts {
  int angle;
  int transmittance;
};
/// With both ends 8 and 16 nodes: whole vector registers.
constexpr NodeCounts coarse_nodes{4, 4};
constexpr NodeCounts fine_nodes{9, 7};
/// Share of the density spread evenly over the nodes' mean, so that what the table can't see (a lobe between
/// nodes, the plane of a one-sided light) is still sampled.
constexpr float even_share = 0.08f;
/// Beyond this optical distance nothing of a segment is tabulated (exp(-16) = 1e-7, below float's resolution
/// of the sum).
constexpr float most_optical_distance = 16.0f;
/// The box is larger than the medium and the light's own fog may end sooner: never discount by more than
/// exp(-4).
constexpr float most_optical_distance_to_light = 4.0f;

}  // namespace

void segment_importance(const MediumSegment& segment, const Light& light, const float* t, int count,
                        float* values) {
  const MediumInfo& medium = *segment.medium;
  light.fluence_along(segment.origin, segment.direction, t, count, values);
  const bool isotropic = medium.phase.is_isotropic();
  const float sigma = medium.mean_sigma_t;
  if (!light.at_infinity()) {
    const LightBounds& bounds = light.bounds();
    const Vec3f to_center = bounds.center - segment.origin;
    const float nearest = glm::dot(to_center, segment.direction);
    const Vec3f offset = to_center - segment.direction * nearest;
    const float height_squared = glm::dot(offset, offset);
    const float radius = bounds.radius;
    for (int i = 0; i < count; ++i) {
      const float along = nearest - t[i];
      const float distance = std::sqrt(height_squared + along * along);
      const float to_light = distance > radius ? sigma * (distance - radius) : 0.0f;
      values[i] *= fast_exp_negative(
          -(to_light < most_optical_distance_to_light ? to_light : most_optical_distance_to_light));
    }
    if (!isotropic) {
      for (int i = 0; i < count; ++i) {
        const float along = nearest - t[i];
        const float distance = std::sqrt(height_squared + along * along);
        // Seen from within its sphere a light has no one direction: the lobe is flattened towards its mean.
        const float cosine = distance > radius ? along / distance : 0.0f;
        values[i] *= 4 * pi * medium.phase.evaluate_cosine(cosine);
      }
    }
  } else {
    const Vec3f to_light = light.direction_from(segment.origin);
    if (to_light != Vec3f(0)) {
      const float phase =
          isotropic ? 1.0f : 4 * pi * medium.phase.evaluate_cosine(glm::dot(segment.direction, to_light));
      for (int i = 0; i < count; ++i) {
        const float optical =
            sigma * medium.extent.exit_distance(segment.origin + segment.direction * t[i], to_light);
        values[i] *=
            phase * fast_exp_negative(-(
                        optical < most_optical_distance_to_light ? optical : most_optical_distance_to_light));
      }
    }
  }
  if (medium.grey) {
    const float scattered = glm::dot(segment.channel_weights, medium.sigma_s);
    for (int i = 0; i < count; ++i) values[i] *= scattered * fast_exp_negative(-sigma * t[i]);
  } else {
    const Vec3f scattered = segment.channel_weights * medium.sigma_s;
    for (int i = 0; i < count; ++i)
      values[i] *= scattered.x * fast_exp_negative(-medium.sigma_t.x * t[i]) +
                   scattered.y * fast_exp_negative(-medium.sigma_t.y * t[i]) +
                   scattered.z * fast_exp_negative(-medium.sigma_t.z * t[i]);
  }
}

DistanceTable::DistanceTable(const MediumSegment& segment, const Light& light, Resolution resolution) {
  const NodeCounts nodes = resolution == Resolution::fine ? fine_nodes : coarse_nodes;
  const MediumInfo& medium = *segment.medium;
  float least_sigma = medium.mean_sigma_t;
  for (int channel = 0; channel < 3; ++channel) {
    if (medium.sigma_s[channel] > 0) least_sigma = std::fmin(least_sigma, medium.sigma_t[channel]);
  }
  const float end = std::fmin(
      segment.length, most_optical_distance / std::fmax(least_sigma, std::numeric_limits<float>::min()));
  if (!(end > 0) || !std::isfinite(end)) return;

  std::array<float, most_nodes> by_angle{};
  int angle_count = 0;
  if (!light.at_infinity()) {
    const LightBounds& bounds = light.bounds();
    const Vec3f to_center = bounds.center - segment.origin;
    const float nearest = glm::dot(to_center, segment.direction);
    const Vec3f offset = to_center - segment.direction * nearest;
    const float height = std::fmax(std::fmax(glm::length(offset), 0.5f * bounds.radius), 1e-4f * end);
    // Unit vectors from the light's side to both ends, in (height, along); nodes lie on the chords between
    // them and, where the nearest point lies inside, the middle direction (1, 0): nearly even in angle,
    // without trigonometry.
    const Vec2f first = glm::normalize(Vec2f(height, -nearest));
    const Vec2f last = glm::normalize(Vec2f(height, end - nearest));
    const bool inside = nearest > 0 && nearest < end;
    for (int i = 1; i < nodes.angle; ++i) {
      const float share = static_cast<float>(i) / static_cast<float>(nodes.angle);
      const Vec2f middle(1, 0);
      const Vec2f towards = !inside        ? first + (last - first) * share
                            : share < 0.5f ? first + (middle - first) * (2 * share)
                                           : middle + (last - middle) * (2 * share - 1);
      by_angle[static_cast<size_t>(angle_count++)] = nearest + height * (towards.y / towards.x);
    }
  }
  std::array<float, most_nodes> by_transmittance{};
  const int steps = light.at_infinity() ? nodes.angle + nodes.transmittance - 1 : nodes.transmittance;
  const float sigma = medium.mean_sigma_t;
  const float opacity = 1 - fast_exp_negative(-sigma * end);
  for (int i = 1; i < steps; ++i) {
    const float share = static_cast<float>(i) / static_cast<float>(steps);
    by_transmittance[static_cast<size_t>(i - 1)] =
        opacity > 1e-3f ? -std::log(1 - opacity * share) / sigma : end * share;
  }
  std::array<float, most_nodes> merged{};
  std::merge(by_angle.begin(), by_angle.begin() + angle_count, by_transmittance.begin(),
             by_transmittance.begin() + steps - 1, merged.begin());
  const int inner = angle_count + steps - 1;
  position_[0] = 0;
  count_ = 1;
  for (int i = 0; i < inner; ++i) {
    const float t = merged[static_cast<size_t>(i)];
    if (t > position_[static_cast<size_t>(count_ - 1)] && t < end)
      position_[static_cast<size_t>(count_++)] = t;
  }
  position_[static_cast<size_t>(count_++)] = end;

  // Up to whole registers; what is computed past the last node is not used.
  const int padded = (count_ + 7) / 8 * 8;
  for (int i = count_; i < padded; ++i) position_[static_cast<size_t>(i)] = end;
  segment_importance(segment, light, position_.data(), padded, value_.data());
  bool any = false;
  float area = 0;
  for (int i = 0; i < count_; ++i) {
    const auto k = static_cast<size_t>(i);
    any = any || value_[k] > 0;
    if (i > 0) area += 0.5f * (value_[k - 1] + value_[k]) * (position_[k] - position_[k - 1]);
  }
  // One-sided lights reach a half space: light arrives somewhere between the nodes only if it does at one of
  // the ends.
  if (!any) return;
  if (!std::isfinite(area)) return;
  total_ = area;
  const float floor = even_share * std::fmax(area, std::numeric_limits<float>::min()) / end;
  cumulative_[0] = 0;
  for (int i = 0; i < count_; ++i) {
    const auto k = static_cast<size_t>(i);
    value_[k] += floor;
    if (i > 0)
      cumulative_[k] =
          cumulative_[k - 1] + 0.5f * (value_[k - 1] + value_[k]) * (position_[k] - position_[k - 1]);
  }
  if (!(total_ > 0)) total_ = std::numeric_limits<float>::min();
}

float DistanceTable::sample(float u) const {
  const auto last = static_cast<size_t>(count_ - 1);
  const float target = u * cumulative_[last];
  size_t k = 1;
  while (k < last && target >= cumulative_[k]) ++k;
  const float a = value_[k - 1];
  const float b = value_[k];
  const float width = position_[k] - position_[k - 1];
  // Invert a s + (b - a) s^2 / 2 = area / width on [0, 1], in the form without cancellation.
  const float share = (target - cumulative_[k - 1]) / width;
  const float s = 2 * share / (a + std::sqrt(std::fmax(a * a + 2 * (b - a) * share, 0.0f)));
  return position_[k - 1] + width * std::clamp(s, 0.0f, one_minus_epsilon);
}

float DistanceTable::pdf(float t) const {
  const auto last = static_cast<size_t>(count_ - 1);
  if (count_ == 0 || !(t >= 0) || t > position_[last]) return 0;
  size_t k = 1;
  while (k < last && t >= position_[k]) ++k;
  const float s = (t - position_[k - 1]) / (position_[k] - position_[k - 1]);
  return (value_[k - 1] + s * (value_[k] - value_[k - 1])) / cumulative_[last];
}

}  // namespace fogbank::transport
