#include "transport/direct_light.h"

#include <algorithm>
#include <optional>

namespace fogbank::transport {

namespace {

float weight_of(const Light& light, EmissionFoundBy found_by, float density, float other) {
  return light.is_delta() || found_by == EmissionFoundBy::light_sampling ? 1.0f
                                                                         : power_heuristic(density, other);
}

/// Light from the emitters at a point, weighed by a density over directions, `density`, that path sampling
/// draws them from; one sample.
template <typename Density>
Spectrum direct_light_at(const World& world, const Vec3f& position, int32_t medium, EmissionFoundBy found_by,
                         const Density& density, RandomStream& random, RayCounters& counters) {
  const LightReceiver receiver{position, Vec3f(0),
                               medium == scene::none ? 0 : world.medium(medium).mean_sigma_t};
  float u = random.next_float();
  const Vec2f u_light = random.next_vec2();
  const std::optional<LightChoice> choice = world.lights().choose(receiver, u);
  if (!choice) return Spectrum(0);
  const Light& light = world.lights().light(choice->light);
  const std::optional<LightSample> sample = light.sample(position, u_light);
  if (!sample || is_black(sample->radiance)) return Spectrum(0);
  const float pdf = choice->probability * sample->pdf;
  const float share = density(sample->direction);
  return world.visibility(position, sample->direction, sample->distance, medium, counters) *
         sample->radiance * (share * weight_of(light, found_by, pdf, share) / pdf);
}

}  // namespace

float power_heuristic(float density, float other) {
  if (!(density > 0)) return 0;
  if (!std::isfinite(density)) return 1;
  const float ratio = other / density;
  return 1 / (1 + ratio * ratio);
}

LightReceiver receiver_at(const World& world, const scene::SurfaceInteraction& surface, const Bsdf& bsdf,
                          float cos_viewer, int32_t medium) {
  return {surface.position,
          bsdf.transmits() ? Vec3f(0) : (cos_viewer > 0 ? surface.shading_normal : -surface.shading_normal),
          medium == scene::none ? 0 : world.medium(medium).mean_sigma_t};
}

DistanceTable::Resolution resolution_for(int32_t samples) {
  return samples > 1 ? DistanceTable::Resolution::fine : DistanceTable::Resolution::coarse;
}

Spectrum in_scattered_radiance(const World& world, const MediumSegment& segment, int32_t medium_index,
                               int32_t samples, EmissionFoundBy found_by, RandomStream& random,
                               RayCounters& counters) {
  const MediumInfo& medium = *segment.medium;
  Spectrum sum(0);
  std::optional<DistanceTable> table;
  uint32_t table_light = 0;
  for (int32_t i = 0; i < samples; ++i) {
    // Stratified over the samples of one segment.
    float u = std::fmin((static_cast<float>(i) + random.next_float()) / static_cast<float>(samples),
                        one_minus_epsilon);
    const float u_distance = random.next_float();
    const Vec2f u_light = random.next_vec2();
    const std::optional<LightChoice> choice = world.lights().choose(segment, u);
    if (!choice) continue;
    const Light& light = world.lights().light(choice->light);
    if (!table || table_light != choice->light) {
      table.emplace(segment, light, resolution_for(samples));
      table_light = choice->light;
    }
    if (!table->can_contribute()) continue;
    const float t = table->sample(samples > 1 ? u : u_distance);
    const Vec3f position = segment.origin + segment.direction * t;
    const std::optional<LightSample> sample = light.sample(position, u_light);
    if (!sample || is_black(sample->radiance)) continue;
    const float phase = medium.phase.evaluate(segment.direction, sample->direction);
    const float pdf = choice->probability * table->pdf(t) * sample->pdf;
    const Spectrum scattered =
        medium.sigma_s * transmittance(medium.sigma_t, t) * sample->radiance * (phase / pdf);
    if (!(pdf > 0) || is_black(scattered)) continue;
    const Spectrum visible =
        world.visibility(position, sample->direction, sample->distance, medium_index, counters);
    if (is_black(visible)) continue;
    const float other = found_by == EmissionFoundBy::light_sampling ? 0 : segment.scatter_pdf(t) * phase;
    sum += scattered * visible * weight_of(light, found_by, pdf * static_cast<float>(samples), other);
  }
  return sum / static_cast<float>(samples);
}

Spectrum reflected_direct_light(const World& world, const scene::SurfaceInteraction& surface,
                                const Vec3f& ray_direction, int32_t medium, EmissionFoundBy found_by,
                                RandomStream& random, RayCounters& counters) {
  const Bsdf& bsdf = world.bsdf(surface.shape);
  if (!bsdf.has_smooth_lobes()) return Spectrum(0);
  const ShadingPoint point = World::shading_point(surface);
  const Vec3f wo = point.frame.to_local(-ray_direction);
  const LightReceiver receiver = receiver_at(world, surface, bsdf, wo.z, medium);
  float u = random.next_float();
  const Vec2f u_light = random.next_vec2();
  const std::optional<LightChoice> choice = world.lights().choose(receiver, u);
  if (!choice) return Spectrum(0);
  const Light& light = world.lights().light(choice->light);
  const std::optional<LightSample> sample = light.sample(surface.position, u_light);
  if (!sample || is_black(sample->radiance)) return Spectrum(0);
  const BsdfValue bsdf_value = bsdf.evaluate_with_pdf(point, wo, point.frame.to_local(sample->direction));
  if (is_black(bsdf_value.value)) return Spectrum(0);
  const Vec3f origin = surface.spawn_origin(sample->direction);
  const int32_t medium_towards = world.medium_beyond(surface, sample->direction, medium);
  const Spectrum visible =
      world.visibility(origin, sample->direction, sample->distance, medium_towards, counters);
  if (is_black(visible)) return Spectrum(0);
  const float pdf = choice->probability * sample->pdf;
  const float weight = weight_of(light, found_by, pdf, bsdf_value.pdf);
  return bsdf_value.value * sample->radiance * visible * (weight / pdf);
}

Spectrum mean_direct_light(const World& world, const Vec3f& position, int32_t medium,
                           EmissionFoundBy found_by, RandomStream& random, RayCounters& counters) {
  return direct_light_at(
      world, position, medium, found_by, [](const Vec3f&) { return inv_4pi; }, random, counters);
}

MediumLight scattered_direct_light(const World& world, const Vec3f& position, const Vec3f& ray_direction,
                                   int32_t medium, EmissionFoundBy found_by, RandomStream& random,
                                   RayCounters& counters) {
  const PhaseFunction& phase = world.medium(medium).phase;
  float density = inv_4pi;
  const Spectrum scattered = direct_light_at(
      world, position, medium, found_by,
      [&](const Vec3f& direction) { return density = phase.evaluate(ray_direction, direction); }, random,
      counters);
  return {scattered, scattered * (inv_4pi / density)};
}

}  // namespace fogbank::transport
