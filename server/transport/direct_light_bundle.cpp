#include "transport/direct_light_bundle.h"

#include <array>
#include <optional>

namespace fogbank::transport {

namespace {

constexpr auto most = static_cast<size_t>(most_bundle_samples);

}  // namespace

Spectrum in_scattered_radiance_bundle(const World& world, const MediumSegment& segment, int32_t medium_index,
                                      LightSubset subset, int32_t samples, RandomStream& random,
                                      RayCounters& counters) {
  const MediumInfo& medium = *segment.medium;
  BundlePoints points(samples, random);
  std::array<LightChoice, most> choices;
  world.lights().choose(segment, subset, points.first(), choices);
  std::optional<DistanceTable> table;
  uint32_t table_light = 0;
  ShadowRays rays;
  for (size_t i = 0; i < points.first().size(); ++i) {
    const LightChoice& choice = choices[i];
    if (!(choice.probability > 0)) continue;
    const Light& light = world.lights().light(choice.light);
    if (!table || table_light != choice.light) {
      table.emplace(segment, light, resolution_for(samples));
      table_light = choice.light;
    }
    if (!table->can_contribute()) continue;
    const float t = table->sample(points.first()[i]);
    const Vec3f position = segment.origin + segment.direction * t;
    const std::optional<LightSample> sample = light.sample(position, points.others(i));
    if (!sample || is_black(sample->radiance)) continue;
    const float phase = medium.phase.evaluate(segment.direction, sample->direction);
    const float pdf = choice.probability * table->pdf(t) * sample->pdf;
    const Spectrum scattered =
        medium.sigma_s * transmittance(medium.sigma_t, t) * sample->radiance * (phase / pdf);
    if (pdf > 0 && !is_black(scattered)) rays.add({position, sample->direction, sample->distance}, scattered);
  }
  return rays.trace(world, medium_index, counters) / static_cast<float>(samples);
}

Spectrum reflected_direct_light_bundle(const World& world, const scene::SurfaceInteraction& surface,
                                       const Vec3f& ray_direction, int32_t medium, int32_t samples,
                                       EmissionFoundBy found_by, RandomStream& random,
                                       RayCounters& counters) {
  const Bsdf& bsdf = world.bsdf(surface.shape);
  if (!bsdf.has_smooth_lobes()) return Spectrum(0);
  const ShadingPoint point = World::shading_point(surface);
  const Vec3f wo = point.frame.to_local(-ray_direction);
  BundlePoints points(samples, random);
  std::array<LightChoice, most> choices;
  world.lights().choose(receiver_at(world, surface, bsdf, wo.z, medium), LightSubset::besides_parallel,
                        points.first(), choices);
  // Light that arrives from behind may come through another medium.
  ShadowRays front;
  ShadowRays back;
  int32_t front_medium = medium;
  int32_t back_medium = medium;
  const auto add = [&](const Light& light, float samples_of_it, const Vec2f& u) {
    const std::optional<LightSample> sample = light.sample(surface.position, u);
    if (!sample || is_black(sample->radiance)) return;
    const BsdfValue value = bsdf.evaluate_with_pdf(point, wo, point.frame.to_local(sample->direction));
    const float pdf = samples_of_it * sample->pdf;
    if (!(pdf > 0) || is_black(value.value)) return;
    const float weight = light.is_delta() || found_by == EmissionFoundBy::light_sampling
                             ? 1.0f
                             : power_heuristic(pdf, value.pdf);
    const bool outside = glm::dot(sample->direction, surface.geometric_normal) > 0;
    (outside ? front_medium : back_medium) = world.medium_beyond(surface, sample->direction, medium);
    (outside ? front : back)
        .add({surface.spawn_origin(sample->direction), sample->direction, sample->distance},
             value.value * sample->radiance * (weight / pdf));
  };
  for (const uint32_t light : world.lights().parallel_lights())
    add(world.lights().light(light), 1, Vec2f(0.5f));
  for (size_t i = 0; i < points.first().size(); ++i)
    if (choices[i].probability > 0)
      add(world.lights().light(choices[i].light), static_cast<float>(samples) * choices[i].probability,
          points.others(i));
  return front.trace(world, front_medium, counters) + back.trace(world, back_medium, counters);
}

}  // namespace fogbank::transport
