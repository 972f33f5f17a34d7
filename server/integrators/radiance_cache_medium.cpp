// What a camera path sees in media: records along its segments, samples where there are none.
#include <algorithm>
#include <array>
#include <cmath>

#include "cache/ray_visibility.h"
#include "integrators/radiance_cache_walk.h"
#include "transport/direct_light_bundle.h"

namespace fogbank::integrators {

using transport::EmissionFoundBy;
using transport::MediumInfo;
using transport::MediumSegment;

namespace {

/// Paths from places along a camera ray that no record reaches.
constexpr uint32_t uncovered_medium_paths = 4;
/// Records lie in a ball about the scene, of its radius times this: fog without bounds is endless. Beyond,
/// light comes by paths.
constexpr float domain_scale = 1.5f;
/// Less of a segment's light than this comes from outside of the ball: not worth a path.
constexpr float negligible = 1e-6f;

/// Where [0, segment.length] is inside the ball; an empty range where it misses it.
std::pair<float, float> inside_ball(const MediumSegment& segment, const scene::BoundingSphere& ball,
                                    float scale) {
  const Vec3f to_center = ball.center - segment.origin;
  const float middle = glm::dot(to_center, segment.direction);
  const Vec3f offset = to_center - segment.direction * middle;
  const float half = safe_sqrt(sqr(scale * ball.radius) - glm::dot(offset, offset));
  const float first = std::fmax(middle - half, 0.0f);
  const float last = std::fmin(middle + half, segment.length);
  return first < last ? std::pair(first, last) : std::pair(0.0f, 0.0f);
}

}  // namespace

cache::Component RadianceCacheIntegrator::medium_component(const Walk& walk, cache::Quantity quantity) const {
  return {walk.medium, 0, published_.generation, quantity};
}

Spectrum RadianceCacheIntegrator::scattered_path(const Walk& walk, const MediumInfo& medium,
                                                 const Vec3f& position, const Vec3f& direction,
                                                 RandomStream& random, RayCounters& counters) const {
  // Radiance from a direction that the phase function drew has a weight of 1.
  const transport::PhaseSample sample = medium.phase.sample(direction, random.next_vec2());
  return scattered_along(walk, {position, sample.direction, infinity}, walk.medium, random, counters);
}

Spectrum RadianceCacheIntegrator::uncached_light(const Walk& walk, const MediumInfo& medium,
                                                 cache::Quantity quantity, const Vec3f& position,
                                                 const Vec3f& direction, RandomStream& random,
                                                 RayCounters& counters) const {
  if (quantity != technique_.direct(medium))
    return scattered_path(walk, medium, position, direction, random, counters);
  return transport::mean_direct_light(*world_, position, walk.medium, EmissionFoundBy::light_sampling, random,
                                      counters);
}

PixelSample RadianceCacheIntegrator::from_medium(const Walk& walk, const MediumSegment& segment,
                                                 RandomStream& random, RayCounters& counters) const {
  const MediumInfo& medium = *segment.medium;
  PixelSample sum;
  if (const auto direct = technique_.direct(medium); direct && walk.straight)
    sum = from_cache(walk, segment, *direct, random, counters);
  else if (walk.observer == nullptr)
    sum = single_scattering_.sample(segment, walk.medium,
                                    {.seen = walk.straight, .wants_cached = walk.wants_cached},
                                    published_.epoch.get(), random, counters);
  else
    single_scattering_.observe(segment, walk.medium, published_.epoch.get(), walk.throughput, *walk.observer);
  // One scattering event more than for direct light.
  if (settings_.max_depth >= 0 && walk.depth + 2 >= settings_.max_depth) return sum;
  const std::optional<cache::Quantity> rest = technique_.rest(medium);
  if (!rest) {
    if (walk.observer == nullptr)
      sum.sampled += from_beyond(walk, segment, cache::Quantity::rest, 0, 0, random, counters);
    return sum;
  }
  if (!walk.straight && !walk.wants_cached) return sum;
  const PixelSample more = walk.straight ? from_cache(walk, segment, *rest, random, counters)
                                         : from_random_place(walk, segment, *rest, random, counters);
  sum.sampled += more.sampled;
  sum.cached += more.cached;
  return sum;
}

PixelSample RadianceCacheIntegrator::from_cache(const Walk& walk, const MediumSegment& segment,
                                                cache::Quantity quantity, RandomStream& random,
                                                RayCounters& counters) const {
  PixelSample sum;
  const auto [first, last] = inside_ball(segment, world_->scene().bounds, domain_scale);
  if (walk.wants_cached) {
    const float widest_step = published_.typical_radius > 0 ? published_.typical_radius : 1e30f;
    const cache::RayVisibility visibility(world_->scene(), counters);
    const CameraMarch march(segment, first, last, find(medium_component(walk, quantity)), visibility,
                            widest_step);
    if (walk.observer != nullptr) {
      report(walk, segment, quantity, march, visibility);
      return sum;
    }
    sum.cached = from_records(walk, segment, quantity, march, random, counters);
  }
  if (first > 0 || last < segment.length)
    sum.sampled = from_beyond(walk, segment, quantity, first, last, random, counters);
  return sum;
}

Spectrum RadianceCacheIntegrator::from_records(const Walk& walk, const MediumSegment& segment,
                                               cache::Quantity quantity, const CameraMarch& march,
                                               RandomStream& random, RayCounters& counters) const {
  Spectrum sum(0);
  float uncovered = 0;
  for (const MarchNode& node : march.nodes()) {
    sum += node.weight * node.radiance;
    if (!node.known) uncovered += mean(node.weight);
  }
  if (!(uncovered > 0)) return sum;
  // Some of the places that no record reaches, by weight, evenly.
  const float step = uncovered / static_cast<float>(uncovered_medium_paths);
  float target = random.next_float() * step;
  Spectrum paths(0);
  for (size_t i = 0; i < march.nodes().size(); ++i) {
    const MarchNode& node = march.nodes()[i];
    if (node.known) continue;
    const float weight = mean(node.weight);
    target -= weight;
    while (target < 0) {
      target += step;
      const MarchSample place = march.sample_around(i, random);
      paths += place.weight * (step / weight) *
               uncached_light(walk, *segment.medium, quantity, segment.origin + segment.direction * place.t,
                              segment.direction, random, counters);
    }
  }
  return sum + paths;
}

PixelSample RadianceCacheIntegrator::from_random_place(const Walk& walk, const MediumSegment& segment,
                                                       cache::Quantity quantity, RandomStream& random,
                                                       RayCounters& counters) const {
  const MarchSample place = sample_distance(segment, 0, segment.length, random);
  if (is_black(place.weight)) return {};
  const Vec3f position = segment.origin + segment.direction * place.t;
  const cache::Index* index = find(medium_component(walk, quantity));
  cache::Interpolation found;
  if (index != nullptr) {
    const std::optional<cache::ScatteredDirection> direction = scattered_direction(segment);
    const cache::ScatteredDirection* scattered = direction ? &*direction : nullptr;
    found = index->look_up(position, scattered);
    index->recover_visible(position, Vec3f(0), cache::RayVisibility(world_->scene(), counters), found,
                           scattered);
  }
  if (found.weight > 0) return {.cached = place.weight * found.radiance};
  return {.cached = place.weight *
                    scattered_path(walk, *segment.medium, position, segment.direction, random, counters)};
}

Spectrum RadianceCacheIntegrator::from_beyond(const Walk& walk, const MediumSegment& segment,
                                              cache::Quantity quantity, float first, float last,
                                              RandomStream& random, RayCounters& counters) const {
  const float sigma = segment.medium->mean_sigma_t;
  const auto through = [&](float t) { return std::exp(-sigma * t); };  // of infinity: 0
  const float before = 1 - through(first);
  const float share = before + through(last) - through(segment.length);
  if (!(share > negligible)) return Spectrum(0);
  const bool is_before = random.next_float() * share < before;
  const MarchSample place = is_before ? sample_distance(segment, 0, first, random)
                                      : sample_distance(segment, last, segment.length, random);
  const float probability = (is_before ? before : share - before) / share;
  if (is_black(place.weight)) return Spectrum(0);
  return place.weight / probability *
         uncached_light(walk, *segment.medium, quantity, segment.origin + segment.direction * place.t,
                        segment.direction, random, counters);
}

void RadianceCacheIntegrator::report(const Walk& walk, const MediumSegment& segment, cache::Quantity quantity,
                                     const CameraMarch& march,
                                     const cache::VisibilityTest& visibility) const {
  const std::span<const MarchNode> nodes = march.nodes();
  // Least sum of a record's radius and the way to it, from either side.
  std::array<float, CameraMarch::most_nodes> reach;
  float least = infinity;
  const auto step = [&](size_t i, size_t before) {
    least += std::fabs(nodes[i].t - nodes[before].t);
    if (nodes[i].found.weight > 0) least = std::fmin(least, nodes[i].found.radius);
  };
  for (size_t i = 0; i < nodes.size(); ++i) {
    step(i, i > 0 ? i - 1 : i);
    reach[i] = least;
  }
  least = infinity;
  for (size_t i = nodes.size(); i-- > 0;) {
    step(i, i + 1 < nodes.size() ? i + 1 : i);
    reach[i] = std::fmin(reach[i], least);
  }
  const cache::Component component = medium_component(walk, quantity);
  for (size_t i = 0; i < nodes.size(); ++i)
    walk.observer->look_up({{segment.origin + segment.direction * nodes[i].t, Vec3f(0), component},
                            nodes[i].found,
                            walk.throughput * nodes[i].weight,
                            segment.direction,
                            nodes[i].t,
                            segment.length - nodes[i].t,
                            reach[i],
                            march.scattered(),
                            &visibility});
}

}  // namespace fogbank::integrators
