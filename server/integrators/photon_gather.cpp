#include "integrators/photon_gather.h"

#include <algorithm>

#include "transport/direct_light.h"

namespace fogbank::integrators {

namespace {

using transport::Bsdf;
using transport::EmissionFoundBy;
using transport::MediumInfo;
using transport::PhotonBeam;
using transport::SurfacePhoton;

/// Where a surface scatters into a direction with a higher density, 1/sr, the camera's path goes on in it;
/// below photons are gathered, for all of a Lambertian surface (1 / pi) and most of a lobe of roughness 0.3.
/// Photons gathered through a narrow lobe would be noisy; paths that go on can't find caustics of small
/// lights.
constexpr float narrow_lobe = 2.0f;
/// Photons on surfaces that face elsewhere, or that lie further from the plane of the surface than this share
/// of the radius, belong to other surfaces.
constexpr float least_cosine_of_normals = 0.7f;
constexpr float most_height = 0.5f;
/// A beam that is closer to parallel to a ray says little about its neighbours: an observer is told less.
constexpr float observed_sine = 0.3f;
/// Samples of the lights at a place: next to what gathering takes they cost nothing.
constexpr int32_t direct_light_samples = 4;
/// As in PathTracer.
constexpr float most_survival = 0.999f;
constexpr int32_t most_null_events = 1024;

/// Epanechnikov's kernels on a line and on a disk: of all kernels with compact support they have the least
/// mean square error. Integral 1; 0 from `radius` on.
float line_kernel(float gap, float radius) {
  const float share = gap / radius;
  return 0.75f / radius * std::fmax(1 - share * share, 0.0f);
}
float disk_kernel(float distance_squared, float radius) {
  const float radius_squared = radius * radius;
  return 2 * inv_pi / radius_squared * std::fmax(1 - distance_squared / radius_squared, 0.0f);
}

/// Transmittance from the beam's origin to the camera, over the share of beams that get as far.
Spectrum weight_along(const MediumInfo& medium, float end_rate, const BeamCrossing& crossing) {
  const float length = crossing.camera_distance + crossing.beam_distance;
  const float kept = end_rate * crossing.beam_distance;
  if (medium.grey) return Spectrum(std::exp(kept - medium.sigma_t.x * length));
  return {std::exp(kept - medium.sigma_t.x * length), std::exp(kept - medium.sigma_t.y * length),
          std::exp(kept - medium.sigma_t.z * length)};
}

}  // namespace

struct PhotonGather::Walk {
  Ray ray;
  Spectrum throughput{1};
  int32_t medium = scene::none;
  int32_t depth = 0;  ///< scattering events so far
  float eta = 1;      ///< product of relative indices
  int32_t null_events = 0;
  bool sees_emission = true;
  bool only_emission = false;  ///< all else was gathered where this direction was drawn
  // How the direction was drawn, for multiple importance sampling; 0: by a Dirac lobe, or the camera.
  float last_pdf = 0;
  Vec3f last_position{0};
  transport::LightReceiver last_receiver;
};

bool PhotonGather::may_scatter(const Walk& walk) const {
  return settings_.max_depth < 0 || walk.depth + 1 < settings_.max_depth;
}

float PhotonGather::emitter_weight(const Walk& walk, uint32_t light_index,
                                   const scene::SurfaceInteraction* hit) const {
  if (walk.last_pdf == 0) return 1;
  std::optional<scene::SurfaceInteraction> seen;
  if (hit != nullptr) {
    seen = *hit;
    seen->distance = glm::length(hit->position - walk.last_position);
  }
  const transport::LightSampler& lights = world_->lights();
  const float pdf = lights.light(light_index)
                        .pdf(walk.last_position, walk.ray.direction, hit != nullptr ? &*seen : nullptr);
  return transport::power_heuristic(walk.last_pdf, lights.probability(walk.last_receiver, light_index) * pdf);
}

Spectrum PhotonGather::emission(const Walk& walk, const scene::SurfaceInteraction* surface) const {
  Spectrum sum(0);
  if (!walk.sees_emission) return sum;
  if (surface == nullptr) {
    for (const uint32_t light : world_->environments()) {
      sum += world_->lights().light(light).emitted(walk.ray.direction, nullptr) *
             emitter_weight(walk, light, nullptr);
    }
    return sum;
  }
  const uint32_t light = world_->light_of_hit(surface->shape, surface->primitive);
  if (light == transport::SceneLights::no_light) return sum;
  return world_->lights().light(light).emitted(walk.ray.direction, surface) *
         emitter_weight(walk, light, surface);
}

Gathered PhotonGather::from_beams(const Walk& walk, float length, const PhotonPass& pass,
                                  PhotonObserver* observer) const {
  Gathered sum;
  if (!pass.beams || !may_scatter(walk)) return sum;
  const MediumInfo& medium = world_->medium(walk.medium);
  const float end_rate = transport::PhotonTracer::end_rate(medium);
  const PhotonBeamGrid& grid = *pass.beams;
  const float radius = grid.radius();
  grid.find({walk.ray.origin, walk.ray.direction, length}, [&](const BeamCrossing& crossing) {
    const PhotonBeam& beam = grid.beam(crossing.beam);
    if (beam.medium != walk.medium) return;
    if (settings_.max_depth >= 0 && static_cast<int64_t>(beam.depth) + walk.depth + 2 > settings_.max_depth)
      return;
    const float phase = medium.phase.evaluate(beam.direction, -walk.ray.direction);
    const Spectrum strength = beam.flux * weight_along(medium, end_rate, crossing) * (phase / crossing.sine);
    const Spectrum value = strength * line_kernel(crossing.gap, radius);
    sum.radiance += value;
    sum.narrow += strength * line_kernel(crossing.gap, 0.5f * radius);
    if (observer != nullptr) {
      observer->beam(beam.path, luminance(walk.throughput * medium.sigma_s * value) *
                                    std::fmin(crossing.sine / observed_sine, 1.0f));
    }
  });
  return {sum.radiance * medium.sigma_s, sum.narrow * medium.sigma_s};
}

Gathered PhotonGather::from_photons(const Walk& walk, const scene::SurfaceInteraction& surface,
                                    const Bsdf& bsdf, const PhotonPass& pass,
                                    PhotonObserver* observer) const {
  Gathered sum;
  if (observer != nullptr) observer->surface();
  if (!pass.photons) return sum;
  const transport::ShadingPoint point = transport::World::shading_point(surface);
  const Vec3f wo = point.frame.to_local(-walk.ray.direction);
  const float radius = pass.photons->radius();
  pass.photons->find(surface.position, [&](const SurfacePhoton& photon, float distance_squared) {
    if (settings_.max_depth >= 0 && static_cast<int64_t>(photon.depth) + walk.depth + 2 > settings_.max_depth)
      return;
    if (glm::dot(photon.geometric_normal, surface.geometric_normal) < least_cosine_of_normals) return;
    const Vec3f offset = photon.position - surface.position;
    const float height = std::fabs(glm::dot(offset, surface.geometric_normal));
    if (height > most_height * radius) return;
    const transport::BsdfValue bsdf_value =
        bsdf.evaluate_with_pdf(point, wo, point.frame.to_local(-photon.direction));
    if (bsdf_value.pdf >= narrow_lobe) return;
    const float cosine = std::fabs(glm::dot(photon.direction, photon.geometric_normal));
    if (!(cosine > 0)) return;
    const Spectrum strength = photon.flux * bsdf_value.value / cosine;
    const Spectrum value = strength * disk_kernel(distance_squared, radius);
    sum.radiance += value;
    if (height <= most_height * 0.5f * radius)
      sum.narrow += strength * disk_kernel(distance_squared, 0.5f * radius);
    if (observer != nullptr) observer->photon(photon.path, luminance(walk.throughput * value));
  });
  return sum;
}

bool PhotonGather::survives_roulette(Walk& walk, RandomStream& random) const {
  if (walk.depth < settings_.rr_depth) return true;
  const float survival = std::fmin(max_component(walk.throughput) * sqr(walk.eta), most_survival);
  if (!(random.next_float() < survival)) return false;
  walk.throughput /= survival;
  return true;
}

bool PhotonGather::go_on(Walk& walk, const scene::SurfaceInteraction& surface, const Bsdf& bsdf,
                         RandomStream& random) const {
  const transport::ShadingPoint point = transport::World::shading_point(surface);
  const Vec3f wo = point.frame.to_local(-walk.ray.direction);
  const float u_lobe = random.next_float();
  const std::optional<transport::BsdfSample> sample = bsdf.sample(point, wo, u_lobe, random.next_vec2());
  if (!sample) return false;
  walk.throughput *= sample->weight;
  if (is_black(walk.throughput)) return false;
  const Vec3f direction =
      sample->null ? walk.ray.direction : glm::normalize(point.frame.to_world(sample->wi));
  if (sample->null) {
    if (++walk.null_events > most_null_events) return false;
  } else {
    if (!may_scatter(walk) || walk.only_emission) return false;
    ++walk.depth;
    walk.sees_emission = true;
    walk.eta *= sample->eta;
    walk.last_pdf = sample->delta ? 0 : sample->pdf;
    walk.last_position = surface.position;
    walk.last_receiver = transport::receiver_at(*world_, surface, bsdf, wo.z, walk.medium);
    // The same number decides in `from_photons`.
    walk.only_emission = !sample->delta && !(bsdf.pdf(point, wo, sample->wi) >= narrow_lobe);
    if (!survives_roulette(walk, random)) return false;
  }
  walk.medium = world_->medium_beyond(surface, direction, walk.medium);
  walk.ray = {surface.spawn_origin(direction), direction, infinity};
  return true;
}

Gathered PhotonGather::radiance(const Ray& ray, const PhotonPass& pass, RandomStream& random,
                                RayCounters& counters, PhotonObserver* observer) const {
  Gathered sum;
  if (settings_.max_depth == 0) return sum;
  const scene::Scene& scene = world_->scene();
  Walk walk;
  walk.ray = ray;
  walk.medium = settings_.camera_medium.value_or(scene.sensor.medium);
  walk.sees_emission = !settings_.hide_emitters;
  while (true) {
    scene::Hit hit;
    ++counters.closest_hit;
    const bool found = scene.intersector->intersect(walk.ray, hit);
    const float length = found ? hit.distance : infinity;
    if (walk.medium != scene::none) {
      if (!walk.only_emission) sum.add(walk.throughput, from_beams(walk, length, pass, observer));
      walk.throughput *= transport::transmittance(world_->medium(walk.medium).sigma_t, length);
      if (is_black(walk.throughput)) return sum;
    }
    if (!found) {
      sum.add(walk.throughput * emission(walk, nullptr));
      return sum;
    }
    const scene::SurfaceInteraction surface = scene.interaction(walk.ray, hit);
    sum.add(walk.throughput * emission(walk, &surface));
    const Bsdf& bsdf = world_->bsdf(hit.shape);
    if (bsdf.has_smooth_lobes() && may_scatter(walk) && !walk.only_emission) {
      const transport::ShadingPoint point = transport::World::shading_point(surface);
      const bool lambertian =
          bsdf.lambertian_reflectance(point, point.frame.to_local(-walk.ray.direction)).has_value();
      const auto found_by =
          lambertian ? EmissionFoundBy::light_sampling : EmissionFoundBy::light_and_path_sampling;
      const int32_t samples = world_->lights().size() == 0 ? 0 : lambertian ? direct_light_samples : 1;
      for (int32_t i = 0; i < samples; ++i) {
        sum.add(walk.throughput / static_cast<float>(samples) *
                reflected_direct_light(*world_, surface, walk.ray.direction, walk.medium, found_by, random,
                                       counters));
      }
      sum.add(walk.throughput, from_photons(walk, surface, bsdf, pass, observer));
      if (lambertian) return sum;
    }
    if (!go_on(walk, surface, bsdf, random)) return sum;
  }
}

}  // namespace fogbank::integrators
