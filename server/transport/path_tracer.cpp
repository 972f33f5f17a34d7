#include "transport/path_tracer.h"

#include <algorithm>
#include <optional>

#include "core/sampling.h"
#include "transport/direct_light.h"

namespace fogbank::transport {

namespace {

/// Samples of single scattering along the camera's own segments, where they decide the image's noise; one
/// each later on.
constexpr int32_t camera_in_scatter_samples = 2;
/// Roulette keeps a path with twice its throughput: half the walls' and the fog's loss is carried as weight.
/// Variance x time of scale 1 over scale 2, one noisy run each: glow 1.4, shafts 1.15, statues room 1.1; of 4
/// over 2: 0.9, 1.2, 1.0. In almost lossless media a fixed loss at every event would cut long walks short and
/// make their weights wild, so the cap only ends paths that never would.
constexpr float roulette_scale = 2.0f;
constexpr float most_survival = 0.999f;
/// Null surfaces passed without a scattering event before a path is given up: a guard against surfaces that
/// coincide.
constexpr int32_t most_null_events = 1024;

/// Emission is also met by the path that goes on.
constexpr EmissionFoundBy both = EmissionFoundBy::light_and_path_sampling;

/// Channels weighted by throughput; equal where there is none.
Vec3f channel_weights(const Spectrum& throughput) {
  const float sum = throughput.x + throughput.y + throughput.z;
  return sum > 0 ? throughput / sum : Vec3f(1.0f / 3);
}

}  // namespace

/// State of one path. `last_*` tell how the current direction was drawn: what MIS needs when it meets a
/// light.
struct PathTracer::Path {
  Ray ray;
  Spectrum throughput{1};
  int32_t medium = scene::none;
  int32_t depth = 0;  ///< scattering events so far
  float eta = 1;      ///< product of relative indices, which radiance scales by and roulette must not see

  int32_t null_events = 0;    ///< surfaces passed straight on
  bool sees_emission = true;  ///< emission that the ray meets counts

  /// A Dirac lobe; a direction drawn at a given point; a distance and a direction drawn along a segment.
  enum class Last : uint8_t { specular, point, segment } last = Last::specular;
  float last_pdf = 0;  ///< density of the direction (point), of distance and direction (segment)
  Vec3f last_position{0};
  LightReceiver last_receiver;  ///< point only
  MediumSegment last_segment;
  float last_distance = 0;   ///< along last_segment
  int32_t last_samples = 1;  ///< samples that in-scattering took along last_segment
};

float PathTracer::emitter_weight(const Path& path, uint32_t light_index, const Vec3f& direction,
                                 const scene::SurfaceInteraction* hit) const {
  if (path.last == Path::Last::specular) return 1;
  const Light& light = world_->lights().light(light_index);
  // The hit's distance counts from the last scattering event, null surfaces in between notwithstanding.
  std::optional<scene::SurfaceInteraction> seen;
  if (hit != nullptr) {
    seen = *hit;
    seen->distance = glm::length(hit->position - path.last_position);
  }
  const float direction_pdf = light.pdf(path.last_position, direction, hit != nullptr ? &*seen : nullptr);
  if (path.last == Path::Last::point) {
    return power_heuristic(path.last_pdf,
                           world_->lights().probability(path.last_receiver, light_index) * direction_pdf);
  }
  const DistanceTable table(path.last_segment, light, resolution_for(path.last_samples));
  if (!table.can_contribute()) return 1;
  const float pdf = world_->lights().probability(path.last_segment, light_index) *
                    table.pdf(path.last_distance) * direction_pdf;
  return power_heuristic(path.last_pdf, pdf * static_cast<float>(path.last_samples));
}

bool PathTracer::survives_roulette(Path& path, RandomStream& random) const {
  if (path.depth < settings_.rr_depth) return true;
  const float survival =
      std::fmin(roulette_scale * max_component(path.throughput) * sqr(path.eta), most_survival);
  if (!(random.next_float() < survival)) return false;
  path.throughput /= survival;
  return true;
}

Spectrum PathTracer::emission(const Path& path, const scene::SurfaceInteraction* surface) const {
  if (!path.sees_emission) return Spectrum(0);
  const Vec3f& direction = path.ray.direction;
  if (surface == nullptr) {
    Spectrum sum(0);
    for (const uint32_t light : world_->environments()) {
      const Spectrum emitted = world_->lights().light(light).emitted(direction, nullptr);
      if (!is_black(emitted)) sum += emitted * emitter_weight(path, light, direction, nullptr);
    }
    return sum;
  }
  const uint32_t light = world_->light_of_hit(surface->shape, surface->primitive);
  if (light == SceneLights::no_light) return Spectrum(0);
  const Spectrum emitted = world_->lights().light(light).emitted(direction, surface);
  return is_black(emitted) ? emitted : emitted * emitter_weight(path, light, direction, surface);
}

bool PathTracer::may_scatter(const Path& path) const {
  return settings_.max_depth < 0 || path.depth + 1 < settings_.max_depth;
}

bool PathTracer::scatter(Path& path, const scene::SurfaceInteraction& surface, RandomStream& random) const {
  const Bsdf& bsdf = world_->bsdf(surface.shape);
  const ShadingPoint point = World::shading_point(surface);
  const Vec3f wo = point.frame.to_local(-path.ray.direction);
  const float u_lobe = random.next_float();
  const std::optional<BsdfSample> sample = bsdf.sample(point, wo, u_lobe, random.next_vec2());
  if (!sample) return false;
  path.throughput *= sample->weight;
  if (is_black(path.throughput)) return false;
  const Vec3f direction =
      sample->null ? path.ray.direction : glm::normalize(point.frame.to_world(sample->wi));
  if (sample->null) {
    if (++path.null_events > most_null_events) return false;
  } else {
    if (!may_scatter(path)) return false;
    ++path.depth;
    path.sees_emission = true;
    path.eta *= sample->eta;
    path.last = sample->delta ? Path::Last::specular : Path::Last::point;
    path.last_pdf = sample->pdf;
    path.last_position = surface.position;
    path.last_receiver = receiver_at(*world_, surface, bsdf, wo.z, path.medium);
    if (!survives_roulette(path, random)) return false;
  }
  path.medium = world_->medium_beyond(surface, direction, path.medium);
  path.ray = {surface.spawn_origin(direction), direction, infinity};
  return true;
}

Spectrum PathTracer::trace(Path& path, RandomStream& random, RayCounters& counters) const {
  const scene::Scene& scene = world_->scene();
  const bool lit = world_->lights().size() > 0;
  Spectrum radiance(0);

  while (true) {
    scene::Hit hit;
    ++counters.closest_hit;
    const bool found = scene.intersector->intersect(path.ray, hit);
    const MediumInfo* medium = path.medium == scene::none ? nullptr : &world_->medium(path.medium);
    const MediumSegment segment{path.ray.origin, path.ray.direction, found ? hit.distance : infinity, medium,
                                channel_weights(path.throughput)};
    const Spectrum through = medium == nullptr ? Spectrum(1) : transmittance(medium->sigma_t, segment.length);

    // What the end of the segment sends out directly is weighted with the transmittance itself; only the
    // path's continuation depends on where a random distance falls.
    std::optional<scene::SurfaceInteraction> surface;
    if (!is_black(through)) {
      if (found && (path.depth == 0 || scene.shapes[hit.shape].emitter != scene::none))
        surface = scene.interaction(path.ray, hit);
      if (surface || !found)
        radiance += path.throughput * through * emission(path, surface ? &*surface : nullptr);
    }
    const bool lit_before_distance = path.depth == 0 && surface.has_value();
    if (lit_before_distance && lit && may_scatter(path))
      radiance +=
          path.throughput * through *
          reflected_direct_light(*world_, *surface, path.ray.direction, path.medium, both, random, counters);

    if (medium != nullptr && !(may_scatter(path) && !is_black(medium->sigma_s * path.throughput))) {
      // Nothing is scattered here, or nothing more may be: what gets through needs no sampling.
      path.throughput *= through;
    } else if (medium != nullptr) {
      const int32_t samples = path.depth == 0 ? camera_in_scatter_samples : 1;
      if (lit)
        radiance += path.throughput * in_scattered_radiance(*world_, segment, path.medium, samples,
                                                            emission_in_media(), random, counters);
      const float u_channel = random.next_float();
      const float t = segment.sample_distance(u_channel, random.next_float());
      if (t < segment.length) {
        const float distance_pdf = segment.scatter_pdf(t);
        path.throughput *= medium->sigma_s * transmittance(medium->sigma_t, t) / distance_pdf;
        ++path.depth;
        path.sees_emission = known_ == nullptr;
        if (const auto rest = known_ ? known_->scattered_before(path.ray.at(t), path.medium) : std::nullopt)
          return radiance + path.throughput * *rest;
        if (!survives_roulette(path, random)) break;
        const PhaseSample phase = medium->phase.sample(path.ray.direction, random.next_vec2());
        path.last = Path::Last::segment;
        path.last_pdf = distance_pdf * phase.pdf;
        path.last_segment = segment;
        path.last_distance = t;
        path.last_samples = samples;
        path.last_position = path.ray.at(t);
        path.ray = {path.last_position, phase.direction, infinity};
        continue;
      }
      const float pass = segment.pass_probability();
      path.throughput = pass > 0 ? path.throughput * through / pass : Spectrum(0);
    }
    if (!found || is_black(path.throughput)) break;

    if (!surface) surface = scene.interaction(path.ray, hit);
    if (!lit_before_distance && lit && may_scatter(path))
      radiance += path.throughput * reflected_direct_light(*world_, *surface, path.ray.direction, path.medium,
                                                           both, random, counters);
    if (!scatter(path, *surface, random)) break;
  }
  return radiance;
}

Spectrum PathTracer::radiance(const Ray& ray, RandomStream& random, RayCounters& counters) const {
  if (settings_.max_depth == 0) return Spectrum(0);
  Path path;
  path.ray = ray;
  path.medium = settings_.camera_medium.value_or(world_->scene().sensor.medium);
  path.sees_emission = !settings_.hide_emitters;
  return trace(path, random, counters);
}

Spectrum PathTracer::scattered_radiance(const scene::SurfaceInteraction& surface, const Vec3f& ray_direction,
                                        int32_t medium, int32_t depth, RandomStream& random,
                                        RayCounters& counters) const {
  counters.poll();
  Path path;
  path.ray.direction = ray_direction;
  path.medium = medium;
  path.depth = depth;
  if (!may_scatter(path)) return Spectrum(0);
  Spectrum radiance(0);
  if (world_->lights().size() > 0)
    radiance = reflected_direct_light(*world_, surface, ray_direction, medium, both, random, counters);
  const bool continues = scatter(path, surface, random);
  if (continues && path.null_events == 0) radiance += trace(path, random, counters);
  return radiance;
}

Spectrum PathTracer::arriving_radiance(const Ray& ray, int32_t medium, int32_t depth, RandomStream& random,
                                       RayCounters& counters, scene::Hit* first_hit) const {
  Path path;
  path.ray = ray;
  path.medium = medium;
  path.depth = depth;
  path.sees_emission = false;
  ++counters.closest_hit;
  if (!world_->scene().intersector->intersect(ray, *first_hit)) first_hit->distance = infinity;
  return trace(path, random, counters);
}

MediumLight PathTracer::light_in_medium(const Vec3f& position, const Vec3f& ray_direction, int32_t medium,
                                        int32_t depth, RandomStream& random, RayCounters& counters) const {
  const PhaseFunction& phase = world_->medium(medium).phase;
  if (phase.is_isotropic()) {
    const Spectrum mean = mean_radiance(position, medium, depth, random, counters);
    return {mean, mean};
  }
  counters.poll();
  Path path;
  path.medium = medium;
  path.depth = depth;
  if (!may_scatter(path)) return {};
  MediumLight light =
      scattered_direct_light(*world_, position, ray_direction, medium, emission_in_media(), random, counters);
  // Radiance from a direction that the phase function drew has a weight of 1.
  const PhaseSample sample = phase.sample(ray_direction, random.next_vec2());
  ++path.depth;
  path.sees_emission = known_ == nullptr;
  path.last = Path::Last::point;
  path.last_pdf = sample.pdf;
  path.last_position = position;
  path.last_receiver = {position, Vec3f(0), world_->medium(medium).mean_sigma_t};
  path.ray = {position, sample.direction, infinity};
  const Spectrum arriving = trace(path, random, counters);
  light.scattered += arriving;
  light.mean += arriving * (inv_4pi / sample.pdf);
  return light;
}

Spectrum PathTracer::mean_radiance(const Vec3f& position, int32_t medium, int32_t depth, RandomStream& random,
                                   RayCounters& counters) const {
  counters.poll();
  Path path;
  path.medium = medium;
  path.depth = depth;
  if (!may_scatter(path)) return Spectrum(0);
  const Spectrum radiance =
      mean_direct_light(*world_, position, medium, emission_in_media(), random, counters);
  if (const auto rest = known_ ? known_->scattered_before(position, medium) : std::nullopt)
    return radiance + *rest;
  ++path.depth;
  path.sees_emission = known_ == nullptr;
  path.last = Path::Last::point;
  path.last_pdf = inv_4pi;
  path.last_position = position;
  path.last_receiver = {position, Vec3f(0), medium == scene::none ? 0 : world_->medium(medium).mean_sigma_t};
  path.ray = {position, square_to_uniform_sphere(random.next_vec2()), infinity};
  return radiance + trace(path, random, counters);
}

}  // namespace fogbank::transport
