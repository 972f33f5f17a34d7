#include "integrators/single_scattering.h"

#include <algorithm>
#include <array>
#include <bit>
#include <utility>

#include "transport/direct_light_bundle.h"
#include "transport/parallel_light.h"

namespace fogbank::integrators {

using derivatives::LightProxy;
using transport::bundle_capacity;
using transport::DistanceTable;
using transport::Light;
using transport::LightChoice;
using transport::LightSubset;
using transport::MediumInfo;
using transport::MediumSegment;

namespace {

/// Samples along one segment that the camera sees, along any other.
constexpr int32_t seen_samples = 4;
constexpr int32_t later_samples = 1;
/// Of shadow maps, in cells; a cell is to be half a pixel wide or more.
constexpr int32_t least_map_side = 128;
constexpr int32_t most_map_side = 2048;
/// Places of a segment that a fill asks for.
constexpr int32_t observed_places = 16;

}  // namespace

SingleScatteringTerm::SingleScatteringTerm(std::shared_ptr<const transport::World> world)
    : world_(std::move(world)) {}

void SingleScatteringTerm::decide(const IntegratorSettings& settings, const CameraRays& camera,
                                  RatioPlaces there) {
  if (std::exchange(decided_, true)) return;
  ratios_then_ = std::move(there);
  plan_ = single_scattering_plan(*world_, settings, camera, ratios_then_);
}

void SingleScatteringTerm::map_shadows(const CameraRays& camera) {
  const std::vector<uint32_t>& lights = world_->lights().parallel_lights();
  if (!shadow_maps_.empty() || lights.empty()) return;
  const Vec2i film = camera.film_size();
  const auto side = static_cast<int32_t>(std::bit_ceil(2 * static_cast<uint32_t>(std::max(film.x, film.y))));
  for (const uint32_t light : lights) {
    auto& maps = shadow_maps_.emplace_back();
    for (size_t i = 0; i < world_->scene().media.size(); ++i) {
      const auto medium = static_cast<int32_t>(i);
      maps.push_back(is_black(world_->medium(medium).sigma_s)
                         ? nullptr
                         : std::make_unique<transport::ShadowMap>(
                               *world_, light, medium, std::clamp(side, least_map_side, most_map_side)));
    }
  }
}

double SingleScatteringTerm::typical_radiance(std::span<const cache::Record> records) const {
  double sum = 0;
  for (const cache::Record& record : records) {
    const auto medium = static_cast<size_t>(record.component.medium);
    for (const auto& proxies : plan_.proxies)
      if (!proxies.empty() && proxies[medium])
        sum += static_cast<double>(luminance(proxies[medium]->value(record.position)));
  }
  return records.empty() ? 0 : sum / static_cast<double>(records.size());
}

SingleScatteringTerm::Cached SingleScatteringTerm::cached(uint32_t light, int32_t medium,
                                                          const cache::Epoch* epoch) const {
  if (!looks_up() || plan_.proxies[light].empty() || medium == scene::none) return {};
  const std::optional<LightProxy>& proxy = plan_.proxies[light][static_cast<size_t>(medium)];
  if (!proxy) return {};
  const cache::Component component{medium, static_cast<uint16_t>(light), 0, cache::Quantity::ratio};
  return {&*proxy, epoch != nullptr ? epoch->find(component) : nullptr};
}

PixelSample SingleScatteringTerm::sample(const MediumSegment& segment, int32_t medium_index,
                                         const SegmentUse& use, const cache::Epoch* epoch,
                                         RandomStream& random, RayCounters& counters) const {
  // For one sample shadow maps would only cost more rays.
  const LightSubset subset =
      use.seen && !shadow_maps_.empty() ? LightSubset::besides_parallel : LightSubset::all;
  PixelSample sum = sample_some(segment, medium_index, subset, use.seen ? seen_samples : later_samples,
                                use.wants_cached, epoch, random, counters);
  if (subset == LightSubset::all) return sum;
  for (size_t i = 0; i < shadow_maps_.size(); ++i)
    if (const auto& map = shadow_maps_[i][static_cast<size_t>(medium_index)])
      sum.sampled += transport::in_scattered_parallel_light(*world_, world_->lights().parallel_lights()[i],
                                                            *map, segment, medium_index, random, counters);
  return sum;
}

PixelSample SingleScatteringTerm::sample_some(const MediumSegment& segment, int32_t medium_index,
                                              LightSubset subset, int32_t samples, bool wants_cached,
                                              const cache::Epoch* epoch, RandomStream& random,
                                              RayCounters& counters) const {
  if (!looks_up())
    return {.sampled = transport::in_scattered_radiance_bundle(*world_, segment, medium_index, subset,
                                                               samples, random, counters)};
  const MediumInfo& medium = *segment.medium;
  transport::BundlePoints points(samples, random);
  const std::span<float> first = points.first();
  std::array<LightChoice, bundle_capacity> choices;
  world_->lights().choose(segment, subset, first, choices);
  transport::ShadowRays sampled;
  transport::ShadowRays uncovered;
  PixelSample sum;
  // Ascending numbers choose the lights in runs.
  for (size_t begin = 0, end = 0; begin < first.size(); begin = end) {
    const LightChoice& choice = choices[begin];
    for (end = begin + 1; end < first.size() && choices[end].light == choice.light; ++end) continue;
    if (!(choice.probability > 0)) continue;
    const Cached known = cached(choice.light, medium_index, epoch);
    if (known.proxy != nullptr && !wants_cached) continue;
    const Light& light = world_->lights().light(choice.light);
    const DistanceTable table(segment, light, DistanceTable::Resolution::fine);
    if (!table.can_contribute()) continue;
    std::array<float, bundle_capacity> distances;
    std::array<Vec3f, bundle_capacity> places;
    std::array<cache::Interpolation, bundle_capacity> found{};
    for (size_t i = begin; i < end; ++i) {
      distances[i] = table.sample(first[i]);
      places[i] = segment.origin + segment.direction * distances[i];
    }
    if (known.index != nullptr)
      known.index->look_up(std::span(places).subspan(begin, end - begin),
                           std::span(found).subspan(begin, end - begin));
    for (size_t i = begin; i < end; ++i) {
      const float pdf = choice.probability * table.pdf(distances[i]);
      if (!(pdf > 0)) continue;
      const Spectrum scattered =
          medium.sigma_s * transport::transmittance(medium.sigma_t, distances[i]) / pdf;
      if (found[i].weight > 0) {
        const Spectrum ratio = glm::min(found[i].radiance, Spectrum(known.proxy->greatest_ratio()));
        sum.cached += scattered * known.proxy->value(places[i]) * ratio;
        continue;
      }
      const std::optional<transport::LightSample> sample = light.sample(places[i], points.others(i));
      if (!sample || is_black(sample->radiance) || !(sample->pdf > 0)) continue;
      const float phase = medium.phase.evaluate(segment.direction, sample->direction);
      const Spectrum radiance = scattered * sample->radiance * (phase / sample->pdf);
      if (!is_black(radiance))
        (known.proxy != nullptr ? uncovered : sampled)
            .add({places[i], sample->direction, sample->distance}, radiance);
    }
  }
  sum.sampled = sampled.trace(*world_, medium_index, counters) / static_cast<float>(samples);
  sum.cached = (sum.cached + uncovered.trace(*world_, medium_index, counters)) / static_cast<float>(samples);
  return sum;
}

void SingleScatteringTerm::observe(const MediumSegment& segment, int32_t medium_index,
                                   const cache::Epoch* epoch, const Spectrum& throughput,
                                   LookUpObserver& observer) const {
  if (!looks_up()) return;
  for (uint32_t light = 0; light < plan_.proxies.size(); ++light) {
    const Cached known = cached(light, medium_index, epoch);
    if (known.proxy == nullptr) continue;
    const DistanceTable table(segment, world_->lights().light(light), DistanceTable::Resolution::fine);
    if (!table.can_contribute()) continue;
    for (int32_t i = 0; i < observed_places; ++i) {
      const float t = table.sample((static_cast<float>(i) + 0.5f) / static_cast<float>(observed_places));
      const float pdf = table.pdf(t) * static_cast<float>(observed_places);
      LookUp look_up;
      look_up.place = {segment.origin + segment.direction * t,
                       Vec3f(0),
                       {medium_index, static_cast<uint16_t>(light), 0, cache::Quantity::ratio}};
      const Spectrum proxy = known.proxy->value(look_up.place.position);
      if (is_black(proxy) || !(pdf > 0)) continue;
      if (known.index != nullptr) look_up.found = known.index->look_up(look_up.place.position);
      look_up.weight = throughput * segment.medium->sigma_s *
                       transport::transmittance(segment.medium->sigma_t, t) * proxy / pdf;
      look_up.direction = segment.direction;
      look_up.behind = t;
      look_up.ahead = segment.length - t;
      look_up.reach = look_up.found.weight > 0 ? look_up.found.radius : infinity;
      observer.look_up(look_up);
    }
  }
}

}  // namespace fogbank::integrators
