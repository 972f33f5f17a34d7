#include "cache/cached_light.h"

#include <array>

#include "cache/ray_visibility.h"
#include "core/sampling.h"
#include "derivatives/medium_march.h"
#include "transport/direct_light.h"

namespace fogbank::cache {

using transport::EmissionFoundBy;

namespace {

constexpr EmissionFoundBy lights_alone = EmissionFoundBy::light_sampling;
/// Points that are looked up together.
constexpr size_t batch_size = 32;
/// Clear surfaces that a ray passes before it is given up, as the path tracer's.
constexpr int32_t most_null_surfaces = 1024;

Spectrum finite_or_black(const Spectrum& sample) { return is_finite(sample) ? sample : Spectrum(0); }

}  // namespace

std::optional<LambertianHit> lambertian(const transport::World& world, const derivatives::SurfaceHit& hit,
                                        uint8_t generation) {
  const transport::ShadingPoint point = transport::World::shading_point(hit.surface);
  const Vec3f wo = point.frame.to_local(-hit.direction);
  const std::optional<Spectrum> reflectance = world.bsdf(hit.surface.shape).lambertian_reflectance(point, wo);
  if (!reflectance) return std::nullopt;
  const Vec3f& normal = hit.surface.shading_normal;
  return LambertianHit{
      *reflectance,
      {hit.surface.position, wo.z < 0 ? -normal : normal, {hit.medium, 0, generation, Quantity::irradiance}}};
}

std::vector<Wish> places_along(const transport::World& world, const Vec3f& origin,
                               std::span<const derivatives::MediumRay> rays,
                               std::span<const derivatives::SurfaceHit> hits, uint8_t generation,
                               RandomStream& random) {
  std::vector<Wish> places;
  for (const derivatives::MediumRay& ray : rays) {
    for (const derivatives::MediumStretch& stretch : ray.stretches) {
      if (stretch.medium == scene::none || is_black(world.medium(stretch.medium).sigma_s)) continue;
      const derivatives::DistanceSample place = derivatives::sample_stratum(
          Vec3d(world.medium(stretch.medium).sigma_t), 0, stretch.end - stretch.begin, random.next_float());
      if (!std::isfinite(place.distance)) continue;
      places.push_back({origin + Vec3f(ray.direction * (stretch.begin + place.distance)),
                        Vec3f(0),
                        {stretch.medium, 0, generation, Quantity::rest}});
    }
  }
  for (const derivatives::SurfaceHit& hit : hits)
    if (const auto found = lambertian(world, hit, generation)) places.push_back(found->irradiance);
  return places;
}

CachedLight::CachedLight(const transport::PathTracer& kernel, const Epoch* records, uint8_t generation)
    : kernel_(kernel), world_(kernel.world()), records_(records), generation_(generation) {}

const Index* CachedLight::rest_index(int32_t medium) const {
  return records_ == nullptr ? nullptr : records_->find({medium, 0, generation_, Quantity::rest});
}

Spectrum CachedLight::rest_by_path(const Vec3f& y, int32_t medium, RandomStream& random,
                                   RayCounters& counters) const {
  counters.poll();
  scene::Hit hit;
  return finite_or_black(
      kernel_.arriving_radiance({y, square_to_uniform_sphere(random.next_vec2()), infinity}, medium,
                                depth + 1, random, counters, &hit));
}

Spectrum CachedLight::mean_radiance(const Vec3f& y, int32_t medium, RandomStream& random,
                                    RayCounters& counters) const {
  Spectrum result;
  mean_radiance_at({&y, 1}, medium, random, counters, {&result, 1});
  return result;
}

void CachedLight::mean_radiance_at(std::span<const Vec3f> points, int32_t medium, RandomStream& random,
                                   RayCounters& counters, std::span<Spectrum> results) const {
  const Index* index = rest_index(medium);
  const RayVisibility visibility(world_.scene(), counters);
  std::array<Interpolation, batch_size> found;
  for (size_t first = 0; first < points.size(); first += batch_size) {
    counters.poll();
    const auto batch = points.subspan(first, std::min(batch_size, points.size() - first));
    if (index != nullptr) index->look_up(batch, found);
    for (size_t i = 0; i < batch.size(); ++i) {
      if (index != nullptr) index->recover_visible(batch[i], Vec3f(0), visibility, found[i]);
      const Spectrum rest =
          found[i].weight > 0 ? found[i].radiance : rest_by_path(batch[i], medium, random, counters);
      results[first + i] = rest + finite_or_black(transport::mean_direct_light(
                                      world_, batch[i], medium, lights_alone, random, counters));
    }
  }
}

Spectrum CachedLight::leaving_radiance(const derivatives::SurfaceHit& hit, int32_t samples,
                                       RandomStream& random, RayCounters& counters) const {
  Spectrum sum(0);
  if (const std::optional<LambertianHit> found = lambertian(world_, hit, generation_)) {
    const Wish& place = found->irradiance;
    const Index* index = records_ == nullptr ? nullptr : records_->find(place.component);
    Interpolation rest;
    if (index != nullptr) {
      rest = index->look_up(place.position, place.normal);
      index->recover_visible(hit.surface.spawn_origin(place.normal), place.normal,
                             RayVisibility(world_.scene(), counters), rest);
    }
    if (rest.weight > 0) {
      for (int32_t i = 0; i < samples; ++i)
        sum += finite_or_black(transport::reflected_direct_light(world_, hit.surface, hit.direction,
                                                                 hit.medium, lights_alone, random, counters));
      return sum / static_cast<float>(samples) + found->reflectance * rest.radiance;
    }
  }
  for (int32_t i = 0; i < samples; ++i)
    sum += finite_or_black(
        kernel_.scattered_radiance(hit.surface, hit.direction, hit.medium, depth, random, counters));
  return sum / static_cast<float>(samples);
}

Spectrum CachedLight::in_scattered(const Ray& ray, float length, int32_t medium, RandomStream& random,
                                   RayCounters& counters) const {
  const transport::MediumInfo& info = world_.medium(medium);
  if (is_black(info.sigma_s)) return Spectrum(0);
  const transport::MediumSegment segment{ray.origin, ray.direction, length, &info, Vec3f(1.0f / 3)};
  const Spectrum direct =
      transport::in_scattered_radiance(world_, segment, medium, 1, lights_alone, random, counters);
  // One look at the rest, its distance drawn by transmittance.
  const derivatives::DistanceSample sample =
      derivatives::sample_stratum(Vec3d(info.sigma_t), 0, length, random.next_float());
  if (!std::isfinite(sample.distance) || !(sample.inverse_pdf > 0)) return direct;
  const auto t = static_cast<float>(sample.distance);
  const Vec3f y = ray.at(t);
  const Index* index = rest_index(medium);
  Interpolation found;
  if (index != nullptr) {
    found = index->look_up(y);
    index->recover_visible(y, Vec3f(0), RayVisibility(world_.scene(), counters), found);
  }
  const Spectrum rest = found.weight > 0 ? found.radiance : rest_by_path(y, medium, random, counters);
  return direct + info.sigma_s * transport::transmittance(info.sigma_t, t) * rest *
                      static_cast<float>(sample.inverse_pdf);
}

Spectrum CachedLight::arriving_radiance(Ray ray, int32_t medium, RandomStream& random, RayCounters& counters,
                                        scene::Hit* solid_hit) const {
  counters.poll();
  const scene::Scene& scene = world_.scene();
  Spectrum radiance(0);
  Spectrum throughput(1);
  float travelled = 0;
  for (int32_t i = 0; i < most_null_surfaces && !is_black(throughput); ++i) {
    scene::Hit hit;
    ++counters.closest_hit;
    const bool found = scene.intersector->intersect(ray, hit);
    const float length = found ? hit.distance : infinity;
    if (medium != scene::none) {
      radiance += throughput * in_scattered(ray, length, medium, random, counters);
      throughput *= transport::transmittance(world_.medium(medium).sigma_t, length);
    }
    if (!found) break;
    const scene::SurfaceInteraction surface = scene.interaction(ray, hit);
    radiance += throughput * leaving_radiance({surface, ray.direction, medium}, 1, random, counters);
    travelled += length;
    const transport::Bsdf& bsdf = world_.bsdf(hit.shape);
    const transport::ShadingPoint point = transport::World::shading_point(surface);
    const Spectrum passed = bsdf.null_transmission(point, point.frame.to_local(-ray.direction));
    if (is_black(passed)) {
      *solid_hit = hit;
      solid_hit->distance = travelled;
      return finite_or_black(radiance);
    }
    throughput *= passed;
    medium = world_.medium_beyond(surface, ray.direction, medium);
    ray.origin = surface.spawn_origin(ray.direction);
  }
  solid_hit->distance = infinity;
  return finite_or_black(radiance);
}

}  // namespace fogbank::cache
