#include "transport/parallel_light.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <optional>

#include "core/sobol.h"
#include "transport/bundle_points.h"

namespace fogbank::transport {

namespace {

using Guess = ShadowMap::Guess;

/// Places along a segment that the map is asked about.
constexpr size_t steps = 32;
/// Least transmittance to the light that places are chosen by, where the guess at it may be wrong.
constexpr float least_transmittance = 1e-3f;

/// Places along the segment.
struct Places {
  std::array<float, steps> distances;
  std::array<Spectrum, steps> unblocked;  ///< over the density of the place; without the way to the light
  std::array<Spectrum, steps> arriving;   ///< the same with that way through the medium
};

/// Places of one guess, in the order of their distance.
struct Group {
  std::array<uint8_t, steps> members;
  size_t count = 0;

  /// Calls use(place, density) for one place in each of `rays` equal parts of the group's weight, where
  /// `weight_of` a place is not negative.
  template <typename Weight, typename Use>
  void draw(size_t rays, float u, const Weight& weight_of, const Use& use) const {
    float total = 0;
    for (size_t i = 0; i < count; ++i) total += weight_of(members[i]);
    if (!(total > 0)) return;
    float passed = 0;
    size_t member = 0;
    for (size_t ray = 0; ray < rays; ++ray) {
      const float target = (static_cast<float>(ray) + u) * total / static_cast<float>(rays);
      while (member + 1 < count && passed + weight_of(members[member]) <= target)
        passed += weight_of(members[member++]);
      const float weight = weight_of(members[member]);
      if (weight > 0) use(members[member], static_cast<float>(rays) * weight / total);
    }
  }
};

}  // namespace

Spectrum in_scattered_parallel_light(const World& world, uint32_t light_index, const ShadowMap& map,
                                     const MediumSegment& segment, int32_t medium_index, RandomStream& random,
                                     RayCounters& counters) {
  const MediumInfo& medium = *segment.medium;
  // Always as many random numbers, whatever there is.
  const std::array<uint32_t, 4> scrambles = random.next_shared();
  const float offset = scrambled_sobol(random.sample(), 0, scrambles[0]);
  const std::optional<LightSample> sample =
      world.lights().light(light_index).sample(segment.origin, Vec2f(0.5f));
  if (!sample || is_black(sample->radiance)) return Spectrum(0);
  const Spectrum scattered =
      medium.sigma_s * sample->radiance * medium.phase.evaluate(segment.direction, sample->direction);
  // The least of the channels: none of them outweighs the others then.
  float sigma = infinity;
  for (int channel = 0; channel < 3; ++channel)
    if (medium.sigma_s[channel] > 0) sigma = std::fmin(sigma, medium.sigma_t[channel]);
  const float opacity = -std::expm1(-sigma * segment.length);
  if (is_black(scattered) || !(opacity > 0)) return Spectrum(0);
  // Straight where the exponential's curve is lost in rounding.
  const bool straight = opacity < 1e-3f;
  if (straight && !std::isfinite(segment.length)) return Spectrum(0);

  Places places;
  std::array<Group, 3> groups{};
  const ShadowMap::Line line = map.line(segment.origin, segment.direction);
  for (size_t i = 0; i < steps; ++i) {
    const float u = (static_cast<float>(i) + offset) / static_cast<float>(steps);
    const float t = straight ? u * segment.length : -std::log(1 - u * opacity) / sigma;
    const float density = straight ? 1 / segment.length : sigma * (1 - u * opacity) / opacity;
    const ShadowMap::Answer answer = map.at(line.origin + line.direction * t, counters);
    places.distances[i] = t;
    places.unblocked[i] = scattered * transmittance(medium.sigma_t, t) / density;
    places.arriving[i] = places.unblocked[i] * glm::max(transmittance(medium.sigma_t, answer.behind_boundary),
                                                        Spectrum(least_transmittance));
    Group& group = groups[static_cast<size_t>(answer.guess)];
    group.members[group.count++] = static_cast<uint8_t>(i);
  }
  const Group& lit = groups[static_cast<size_t>(Guess::lit)];
  const Group& dark = groups[static_cast<size_t>(Guess::dark)];
  const Group& uncertain = groups[static_cast<size_t>(Guess::uncertain)];

  ShadowRays rays;
  const auto add = [&](size_t i, const Spectrum& radiance) {
    rays.add({segment.origin + segment.direction * places.distances[i], sample->direction, sample->distance},
             radiance);
  };
  const auto brightness = [&](size_t i) { return luminance(places.arriving[i]); };
  const auto add_all = [&](size_t i, float density) { add(i, places.unblocked[i] / density); };
  const auto u = [&](const Group& group) {
    return scrambled_sobol(random.sample(), 1, scrambles[static_cast<size_t>(&group - groups.data()) + 1]);
  };
  // What is guessed rightly takes one ray, or, where channels differ, one for each: it has no noise then.
  if (medium.grey) {
    lit.draw(1, u(lit), brightness, add_all);
  } else {
    for (int channel = 0; channel < 3; ++channel)
      lit.draw(
          1, u(lit), [&](size_t i) { return places.arriving[i][channel]; },
          [&](size_t i, float density) {
            Spectrum radiance(0);
            radiance[channel] = places.unblocked[i][channel] / density;
            add(i, radiance);
          });
  }
  // Holes that cells miss are looked for harder where all seems dark.
  const bool all_dark = dark.count == steps;
  dark.draw(all_dark ? 2 : 1, u(dark), brightness, add_all);
  uncertain.draw(4 - std::min<size_t>(lit.count, 1) - std::min<size_t>(dark.count, 1), u(uncertain),
                 brightness, add_all);
  return rays.trace(world, medium_index, counters) / static_cast<float>(steps);
}

}  // namespace fogbank::transport
