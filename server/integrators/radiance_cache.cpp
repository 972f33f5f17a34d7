#include "integrators/radiance_cache.h"

#include <algorithm>
#include <optional>

#include "core/sampling.h"
#include "integrators/radiance_cache_fill.h"
#include "transport/direct_light.h"

namespace fogbank::integrators {

using transport::BsdfSample;
using transport::EmissionFoundBy;
using transport::Light;
using transport::MediumInfo;
using transport::MediumSegment;
using transport::SceneLights;
using transport::ShadingPoint;

namespace {

/// Look-ups along a camera ray.
constexpr int32_t cached_samples = 2;
/// As the path tracer's (path_tracer.cpp).
constexpr float most_survival = 0.999f;
constexpr int32_t most_null_events = 1024;

}  // namespace

/// A camera path: straight through clear surfaces, mirrors and glass, and by one random direction a surface
/// where irradiance isn't enough.
struct RadianceCacheIntegrator::Walk {
  Ray ray;
  Spectrum throughput{1};
  int32_t medium = scene::none;
  int32_t depth = 0;   ///< scattering events so far
  float last_pdf = 0;  ///< of the direction; 0: emission counts in full
  bool sees_emission = true;
  bool ended = false;
  int32_t null_events = 0;  ///< surfaces passed straight on
  Vec3f last_position{0};
  transport::LightReceiver last_receiver;
  std::vector<cache::Wish>* uncovered = nullptr;
};

RadianceCacheIntegrator::RadianceCacheIntegrator(std::shared_ptr<const transport::World> world,
                                                 const IntegratorSettings& settings)
    : world_(std::move(world)),
      settings_(settings),
      kernel_(world_, {settings.max_depth, settings.rr_depth, settings.hide_emitters}),
      single_scattering_(world_),
      cache_(settings.cache ? settings.cache : std::make_shared<cache::SceneCache>()),
      records_at_start_(cache_->records()->size()) {}

void RadianceCacheIntegrator::publish(std::shared_ptr<const cache::Epoch> epoch, uint64_t records_new) {
  epoch_ = std::move(epoch);
  records_new_ += records_new;
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
    const float pdf = lights.probability(walk.last_receiver, index) *
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

PixelSample RadianceCacheIntegrator::from_medium(const Walk& walk, const MediumSegment& segment,
                                                 RandomStream& random, RayCounters& counters) const {
  const MediumInfo& medium = *segment.medium;
  PixelSample sum;
  if (walk.uncovered == nullptr)
    sum = single_scattering_.sample(segment, walk.medium, epoch_.get(), random, counters);
  else
    single_scattering_.find_uncovered(segment, walk.medium, epoch_.get(), *walk.uncovered);
  // One scattering event more than for direct light.
  if (settings_.max_depth >= 0 && walk.depth + 2 >= settings_.max_depth) return sum;
  const cache::Component component{walk.medium, 0, 0, cache::Quantity::rest};
  const cache::Index* index = epoch_ ? epoch_->find(component) : nullptr;
  const float sigma = medium.mean_sigma_t;
  const float share = std::isfinite(segment.length) ? -std::expm1(-sigma * segment.length) : 1.0f;
  if (!(share > 0)) return sum;
  for (int32_t i = 0; i < cached_samples; ++i) {
    // By transmittance of the mean extinction, in strata.
    const float u = (static_cast<float>(i) + random.next_float()) / static_cast<float>(cached_samples);
    const float t = std::fmin(-std::log1p(-u * share) / sigma, segment.length);
    const float pdf = sigma * std::exp(-sigma * t) / share;
    const Vec3f position = segment.origin + segment.direction * t;
    const Spectrum weight = medium.sigma_s * transport::transmittance(medium.sigma_t, t) /
                            (pdf * static_cast<float>(cached_samples));
    const cache::Interpolation found = index != nullptr ? index->look_up(position) : cache::Interpolation{};
    if (found.weight > 0) {
      sum.cached += weight * found.radiance;
    } else if (walk.uncovered != nullptr) {
      walk.uncovered->push_back({position, Vec3f(0), component});
    } else {
      scene::Hit hit;
      sum.cached += weight * kernel_.arriving_radiance(
                                 {position, square_to_uniform_sphere(random.next_vec2()), infinity},
                                 walk.medium, walk.depth + 1, random, counters, &hit);
    }
  }
  return sum;
}

Spectrum RadianceCacheIntegrator::from_surface(Walk& walk, const scene::SurfaceInteraction& surface,
                                               RandomStream& random, RayCounters& counters) const {
  const transport::Bsdf& bsdf = world_->bsdf(surface.shape);
  const ShadingPoint point = transport::World::shading_point(surface);
  const Vec3f wo = point.frame.to_local(-walk.ray.direction);
  Spectrum sum(0);
  if (may_scatter(walk) && walk.uncovered == nullptr) {
    sum = transport::reflected_direct_light(*world_, surface, walk.ray.direction, walk.medium,
                                            EmissionFoundBy::light_and_path_sampling, random, counters);
  }
  walk.ended = !go_on(walk, surface, bsdf, point, wo, random);
  return sum;
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

PixelSample RadianceCacheIntegrator::walk_from(const Ray& ray, RandomStream& random, RayCounters& counters,
                                               std::vector<cache::Wish>* uncovered) const {
  if (settings_.max_depth == 0) return {};
  const scene::Scene& scene = world_->scene();
  Walk walk;
  walk.ray = ray;
  walk.medium = scene.sensor.medium;
  walk.sees_emission = !settings_.hide_emitters;
  walk.uncovered = uncovered;
  PixelSample radiance;
  while (!walk.ended) {
    scene::Hit hit;
    ++counters.closest_hit;
    const bool found = scene.intersector->intersect(walk.ray, hit);
    if (walk.medium != scene::none) {
      const MediumInfo& medium = world_->medium(walk.medium);
      const MediumSegment segment{walk.ray.origin, walk.ray.direction, found ? hit.distance : infinity,
                                  &medium, Vec3f(1.0f / 3)};
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
    radiance.sampled += arrived * from_surface(walk, surface, random, counters);
  }
  return radiance;
}

PixelSample RadianceCacheIntegrator::sample(const Ray& ray, RandomStream& random,
                                            RayCounters& counters) const {
  return walk_from(ray, random, counters, nullptr);
}

std::unique_ptr<Preparation> RadianceCacheIntegrator::prepare(const CameraRays& camera,
                                                              const CacheTarget& target) {
  return std::make_unique<RadianceCacheFill>(*this, camera, target);
}

}  // namespace fogbank::integrators
