#include "integrators/radiance_cache.h"

#include <array>
#include <cmath>
#include <optional>

#include "cache/ray_visibility.h"
#include "core/frame.h"
#include "core/sampling.h"
#include "core/sobol.h"
#include "integrators/radiance_cache_fill.h"
#include "integrators/radiance_cache_walk.h"
#include "transport/direct_light_bundle.h"

namespace fogbank::integrators {

using transport::BsdfSample;
using transport::EmissionFoundBy;
using transport::Light;
using transport::MediumInfo;
using transport::MediumSegment;
using transport::SceneLights;
using transport::ShadingPoint;

namespace {

/// Samples of the light that reaches a surface: seen by the camera itself, met later.
constexpr int32_t seen_surface_samples = 4;
constexpr int32_t later_surface_samples = 1;
/// Paths from a surface that no record reaches, if the camera sees it: fine geometry that would take a record
/// for every few pixels.
constexpr uint32_t uncovered_surface_paths = 4;
/// As the path tracer's (path_tracer.cpp).
constexpr float most_survival = 0.999f;
constexpr int32_t most_null_events = 1024;

/// Channels weighted by throughput; equal where there is none.
Vec3f channel_weights(const Spectrum& throughput) {
  const float sum = throughput.x + throughput.y + throughput.z;
  return sum > 0 ? throughput / sum : Vec3f(1.0f / 3);
}

}  // namespace

RadianceCacheIntegrator::RadianceCacheIntegrator(std::shared_ptr<const transport::World> world,
                                                 const IntegratorSettings& settings,
                                                 const CacheTechnique& technique)
    : world_(std::move(world)),
      settings_(settings),
      technique_(technique),
      kernel_(world_, {settings.max_depth, settings.rr_depth, settings.hide_emitters}),
      single_scattering_(world_),
      cache_(settings.cache ? settings.cache : std::make_shared<cache::SceneCache>()),
      records_at_start_(cache_->records()->size()),
      pilot_(world_, technique) {}

void RadianceCacheIntegrator::publish(PublishedCache published, uint64_t records_new) {
  published_ = std::move(published);
  records_new_ += records_new;
  const uint32_t paths = published_.photon_paths;
  if (paths == (ending_photons_ ? ending_photons_->paths() : 0)) return;
  ending_photons_ = paths > 0 ? photons(paths) : nullptr;
  kernel_ = transport::PathTracer(world_, kernel_.settings(), ending_photons_);
}

const std::shared_ptr<cache::PhotonField>& RadianceCacheIntegrator::photons(uint32_t paths) {
  if (!photons_ || photons_->paths() != paths) {
    scene::prepare_render_thread();
    photons_ = std::make_shared<cache::PhotonField>(world_, paths, settings_.max_depth);
  }
  return photons_;
}

std::vector<Decision> RadianceCacheIntegrator::decisions() const {
  std::vector<Decision> decisions = medium_decisions(*world_, technique_);
  decisions.insert(decisions.end(), single_scattering_.decisions().begin(),
                   single_scattering_.decisions().end());
  return decisions;
}

const cache::Index* RadianceCacheIntegrator::find(const cache::Component& component) const {
  return published_.epoch ? published_.epoch->find(component) : nullptr;
}

CacheCounts RadianceCacheIntegrator::cache_counts() const {
  return {records_at_start_, records_new_, cache_->epoch()};
}

bool RadianceCacheIntegrator::may_scatter(const Walk& walk) const {
  return settings_.max_depth < 0 || walk.depth + 1 < settings_.max_depth;
}

Spectrum RadianceCacheIntegrator::emission(const Walk& walk, const scene::SurfaceInteraction* surface) const {
  if (!walk.sees_emission) return Spectrum(0);
  const transport::LightSampler& lights = world_->lights();
  const auto weighted = [&](uint32_t index) {
    const Light& light = lights.light(index);
    const Spectrum emitted = light.emitted(walk.ray.direction, surface);
    if (is_black(emitted) || walk.last_pdf == 0) return emitted;
    std::optional<scene::SurfaceInteraction> seen;
    if (surface != nullptr) {
      seen = *surface;
      seen->distance = glm::length(surface->position - walk.last_position);
    }
    const float pdf =
        static_cast<float>(walk.last_light_samples) *
        lights.probability(walk.last_receiver, index, transport::LightSubset::besides_parallel) *
        light.pdf(walk.last_position, walk.ray.direction, seen ? &*seen : nullptr);
    return emitted * transport::power_heuristic(walk.last_pdf, pdf);
  };
  if (surface == nullptr) {
    Spectrum sum(0);
    for (const uint32_t light : world_->environments()) sum += weighted(light);
    return sum;
  }
  const uint32_t light = world_->light_of_hit(surface->shape, surface->primitive);
  return light == SceneLights::no_light ? Spectrum(0) : weighted(light);
}

Spectrum RadianceCacheIntegrator::scattered_along(const Walk& walk, const Ray& ray, int32_t medium,
                                                  RandomStream& random, RayCounters& counters) const {
  if (!walk.straight) {
    // Only now: who finds records everywhere needs none.
    if (ending_photons_) ending_photons_->complete(counters);
    scene::Hit hit;
    return kernel_.arriving_radiance(ray, medium, walk.depth + 1, random, counters, &hit);
  }
  Walk next;
  next.ray = ray;
  next.medium = medium;
  next.depth = walk.depth + 1;
  next.sees_emission = false;
  next.straight = false;
  const PixelSample arriving = follow(next, random, counters);
  return arriving.sampled + arriving.cached;
}

PixelSample RadianceCacheIntegrator::from_surface(Walk& walk, const scene::SurfaceInteraction& surface,
                                                  RandomStream& random, RayCounters& counters) const {
  const transport::Bsdf& bsdf = world_->bsdf(surface.shape);
  const ShadingPoint point = transport::World::shading_point(surface);
  const Vec3f wo = point.frame.to_local(-walk.ray.direction);
  const std::optional<Spectrum> reflectance = bsdf.lambertian_reflectance(point, wo);
  PixelSample sum;
  if (may_scatter(walk) && walk.observer == nullptr) {
    const EmissionFoundBy found_by =
        reflectance ? EmissionFoundBy::light_sampling : EmissionFoundBy::light_and_path_sampling;
    walk.last_light_samples = walk.straight ? seen_surface_samples : later_surface_samples;
    sum.sampled =
        transport::reflected_direct_light_bundle(*world_, surface, walk.ray.direction, walk.medium,
                                                 walk.last_light_samples, found_by, random, counters);
  }
  if (reflectance) {
    walk.ended = true;
    // One scattering event more than for direct light.
    const bool more = settings_.max_depth < 0 || walk.depth + 2 < settings_.max_depth;
    if (more && walk.wants_cached && !is_black(*reflectance)) {
      const Vec3f side = wo.z > 0 ? surface.shading_normal : -surface.shading_normal;
      sum.cached = *reflectance * arriving_at(walk, surface, side, *reflectance, random, counters);
    }
    return sum;
  }
  walk.ended = !go_on(walk, surface, bsdf, point, wo, random);
  return sum;
}

Spectrum RadianceCacheIntegrator::arriving_at(const Walk& walk, const scene::SurfaceInteraction& surface,
                                              const Vec3f& side, const Spectrum& reflectance,
                                              RandomStream& random, RayCounters& counters) const {
  const int32_t medium = world_->medium_beyond(surface, -walk.ray.direction, walk.medium);
  const cache::Component component{medium, 0, published_.generation, cache::Quantity::irradiance};
  const cache::Index* index = find(component);
  const cache::RayVisibility visibility(world_->scene(), counters);
  cache::Interpolation found;
  if (index != nullptr) {
    found = index->look_up(surface.position, side);
    index->recover_visible(surface.position, side, visibility, found);
  }
  if (walk.observer != nullptr) {
    walk.observer->look_up({.place = {surface.position, side, component},
                            .found = found,
                            .weight = walk.throughput * reflectance,
                            .visibility = &visibility});
    return Spectrum(0);
  }
  if (found.weight > 0) return found.radiance;
  return arriving_by_paths(walk, surface, side, random, counters);
}

Spectrum RadianceCacheIntegrator::arriving_by_paths(const Walk& walk,
                                                    const scene::SurfaceInteraction& surface,
                                                    const Vec3f& side, RandomStream& random,
                                                    RayCounters& counters) const {
  const Frame frame = Frame::from_normal(side);
  const uint32_t paths = walk.straight ? uncovered_surface_paths : 1;
  // Directions go on over the pixel's samples.
  const std::array<uint32_t, 4> scrambles = random.next_shared();
  Spectrum sum(0);
  for (uint32_t i = 0; i < paths; ++i) {
    const uint32_t number = random.sample() * paths + i;
    const Vec3f direction = frame.to_world(square_to_cosine_hemisphere(
        {scrambled_sobol(number, 0, scrambles[0]), scrambled_sobol(number, 1, scrambles[1])}));
    sum += scattered_along(walk, {surface.spawn_origin(direction), direction, infinity},
                           world_->medium_beyond(surface, direction, walk.medium), random, counters);
  }
  return sum / static_cast<float>(paths);
}

bool RadianceCacheIntegrator::go_on(Walk& walk, const scene::SurfaceInteraction& surface,
                                    const transport::Bsdf& bsdf, const ShadingPoint& point, const Vec3f& wo,
                                    RandomStream& random) const {
  const float lobe = random.next_float();
  const std::optional<BsdfSample> sample = bsdf.sample(point, wo, lobe, random.next_vec2());
  if (!sample || is_black(sample->weight)) return false;
  walk.throughput *= sample->weight;
  Vec3f direction = walk.ray.direction;
  if (sample->null) {
    if (++walk.null_events > most_null_events) return false;
  } else {
    if (!may_scatter(walk)) return false;
    walk.straight = walk.straight && sample->delta;
    if (!walk.straight && walk.observer != nullptr) return false;
    direction = glm::normalize(point.frame.to_world(sample->wi));
    ++walk.depth;
    walk.sees_emission = true;
    walk.last_pdf = sample->delta ? 0 : sample->pdf;
    walk.last_position = surface.position;
    walk.last_receiver = transport::receiver_at(*world_, surface, bsdf, wo.z, walk.medium);
    if (walk.depth >= settings_.rr_depth) {
      const float survival = std::fmin(max_component(walk.throughput), most_survival);
      if (!(random.next_float() < survival)) return false;
      walk.throughput /= survival;
    }
  }
  walk.medium = world_->medium_beyond(surface, direction, walk.medium);
  walk.ray = {surface.spawn_origin(direction), direction, infinity};
  return true;
}

PixelSample RadianceCacheIntegrator::walk_from(const Ray& ray, bool wants_cached, RandomStream& random,
                                               RayCounters& counters, LookUpObserver* observer) const {
  if (settings_.max_depth == 0) return {};
  Walk walk;
  walk.ray = ray;
  walk.medium = settings_.camera_medium.value_or(world_->scene().sensor.medium);
  walk.sees_emission = !settings_.hide_emitters;
  walk.wants_cached = wants_cached;
  walk.observer = observer;
  return follow(walk, random, counters);
}

PixelSample RadianceCacheIntegrator::follow(Walk& walk, RandomStream& random, RayCounters& counters) const {
  const scene::Scene& scene = world_->scene();
  PixelSample radiance;
  while (!walk.ended) {
    scene::Hit hit;
    ++counters.closest_hit;
    const bool found = scene.intersector->intersect(walk.ray, hit);
    if (walk.medium != scene::none) {
      const MediumInfo& medium = world_->medium(walk.medium);
      const MediumSegment segment{walk.ray.origin, walk.ray.direction, found ? hit.distance : infinity,
                                  &medium, channel_weights(walk.throughput)};
      if (may_scatter(walk) && !is_black(medium.sigma_s)) {
        const PixelSample scattered = from_medium(walk, segment, random, counters);
        radiance.sampled += walk.throughput * scattered.sampled;
        radiance.cached += walk.throughput * scattered.cached;
      }
      walk.throughput *= transport::transmittance(medium.sigma_t, segment.length);
    }
    if (is_black(walk.throughput)) break;
    if (!found) {
      radiance.sampled += walk.throughput * emission(walk, nullptr);
      break;
    }
    const scene::SurfaceInteraction surface = scene.interaction(walk.ray, hit);
    const Spectrum arrived = walk.throughput;
    radiance.sampled += arrived * emission(walk, &surface);
    const PixelSample scattered = from_surface(walk, surface, random, counters);
    radiance.sampled += arrived * scattered.sampled;
    radiance.cached += arrived * scattered.cached;
  }
  return radiance;
}

PixelSample RadianceCacheIntegrator::sample(const Ray& ray, RandomStream& random,
                                            RayCounters& counters) const {
  return walk_from(ray, true, random, counters, nullptr);
}

PixelSample RadianceCacheIntegrator::sample_without_cache(const Ray& ray, RandomStream& random,
                                                          RayCounters& counters) const {
  return walk_from(ray, false, random, counters, nullptr);
}

void RadianceCacheIntegrator::observe(const Ray& ray, RandomStream& random, RayCounters& counters,
                                      LookUpObserver& observer) const {
  walk_from(ray, true, random, counters, &observer);
}

std::unique_ptr<Preparation> RadianceCacheIntegrator::prepare(const CameraRays& camera,
                                                              const CacheTarget& target) {
  if (technique_.aware) single_scattering_.decide(settings_, camera, ratio_places(*cache_->records()));
  single_scattering_.map_shadows(camera);
  return std::make_unique<RadianceCacheFill>(*this, camera, target);
}

}  // namespace fogbank::integrators
