#include "transport/photon_tracer.h"

#include <algorithm>
#include <optional>

namespace fogbank::transport {

namespace {

/// end_rate over the least sigma_t of the channels that scatter.
constexpr float end_share = 0.5f;
/// Roulette keeps power, but in almost lossless media it must end paths that never would.
constexpr float most_survival = 0.999f;
/// As in PathTracer: a guard against surfaces that coincide.
constexpr int32_t most_null_events = 1024;

Vec3f channel_weights(const Spectrum& flux) {
  const float sum = flux.x + flux.y + flux.z;
  return sum > 0 ? flux / sum : Vec3f(1.0f / 3);
}

}  // namespace

struct PhotonTracer::Photon {
  Ray ray;
  Spectrum flux{0};
  int32_t medium = scene::none;
  uint32_t depth = 0;  ///< scattering events so far
  int32_t null_events = 0;
};

float PhotonTracer::end_rate(const MediumInfo& medium) {
  float least = infinity;
  for (int channel = 0; channel < 3; ++channel) {
    if (medium.sigma_s[channel] > 0) least = std::fmin(least, medium.sigma_t[channel]);
  }
  return least < infinity ? end_share * least : 0.0f;
}

bool PhotonTracer::may_scatter(uint32_t depth) const {
  // The event makes a path of depth + 2 edges at least.
  return settings_.max_depth < 0 || static_cast<int64_t>(depth) + 2 <= settings_.max_depth;
}

bool PhotonTracer::survives_roulette(Photon& photon, float before, RandomStream& random) const {
  if (static_cast<int64_t>(photon.depth) < settings_.rr_depth) return true;
  const float survival = std::fmin(max_component(photon.flux) / before, most_survival);
  if (!(random.next_float() < survival)) return false;
  photon.flux /= survival;
  return true;
}

bool PhotonTracer::scatter_in_medium(Photon& photon, const MediumInfo& medium, const MediumSegment& segment,
                                     float t, RandomStream& random) const {
  const float before = max_component(photon.flux);
  photon.flux *= medium.sigma_s * transmittance(medium.sigma_t, t) / segment.scatter_pdf(t);
  ++photon.depth;
  if (is_black(photon.flux) || !survives_roulette(photon, before, random)) return false;
  const PhaseSample phase = medium.phase.sample(photon.ray.direction, random.next_vec2());
  photon.ray = {photon.ray.at(t), phase.direction, infinity};
  return true;
}

bool PhotonTracer::scatter_at_surface(Photon& photon, const scene::SurfaceInteraction& surface,
                                      RandomStream& random) const {
  const Bsdf& bsdf = world_->bsdf(surface.shape);
  const ShadingPoint point = World::shading_point(surface);
  const Vec3f wi = point.frame.to_local(-photon.ray.direction);
  const float u_lobe = random.next_float();
  // Where light goes, drawn as if it came from there.
  const std::optional<BsdfSample> sample = bsdf.sample(point, wi, u_lobe, random.next_vec2());
  if (!sample) return false;
  if (sample->null) {
    photon.flux *= sample->weight;
    if (is_black(photon.flux) || ++photon.null_events > most_null_events) return false;
  } else {
    if (!may_scatter(photon.depth)) return false;
    const Vec3f direction = glm::normalize(point.frame.to_world(sample->wi));
    const float before = max_component(photon.flux);
    if (sample->delta) {
      // Power, unlike radiance, doesn't scale by 1 / eta^2. Shading normals: Veach 1997, section 5.3.
      const float in = std::fabs(glm::dot(photon.ray.direction, surface.geometric_normal) * sample->wi.z);
      const float out = std::fabs(glm::dot(direction, surface.geometric_normal) * wi.z);
      photon.flux *= sample->weight * (sqr(sample->eta) * out / in);
    } else {
      const float in = std::fabs(glm::dot(photon.ray.direction, surface.geometric_normal));
      const float out = std::fabs(glm::dot(direction, surface.geometric_normal));
      photon.flux *= bsdf.evaluate(point, sample->wi, wi) * (out / (in * sample->pdf));
    }
    if (is_black(photon.flux) || !is_finite(photon.flux)) return false;
    ++photon.depth;
    if (!survives_roulette(photon, before, random)) return false;
    photon.ray.direction = direction;
  }
  photon.medium = world_->medium_beyond(surface, photon.ray.direction, photon.medium);
  photon.ray = {surface.spawn_origin(photon.ray.direction), photon.ray.direction, infinity};
  return true;
}

void PhotonTracer::trace(const EmittedRay& emitted, uint32_t path, RandomStream& random,
                         RayCounters& counters, Photons& photons) const {
  const scene::Scene& scene = world_->scene();
  Photon photon{{emitted.origin, emitted.direction, infinity}, emitted.flux, emitted.medium};
  while (true) {
    scene::Hit hit;
    ++counters.closest_hit;
    const bool found = scene.intersector->intersect(photon.ray, hit);
    const MediumInfo* medium = photon.medium == scene::none ? nullptr : &world_->medium(photon.medium);
    const float length = found ? hit.distance : infinity;
    const bool scatters =
        medium != nullptr && may_scatter(photon.depth) && !is_black(medium->sigma_s * photon.flux);
    if (scatters) {
      const MediumSegment segment{photon.ray.origin, photon.ray.direction, length, medium,
                                  channel_weights(photon.flux)};
      const float end = -std::log(1 - random.next_float()) / end_rate(*medium);
      photons.beams.push_back({photon.ray.origin, photon.ray.direction, std::fmin(length, end), photon.flux,
                               photon.medium, photon.depth, path});
      const float u_channel = random.next_float();
      const float t = segment.sample_distance(u_channel, random.next_float());
      if (t < length) {
        if (!scatter_in_medium(photon, *medium, segment, t, random)) return;
        continue;
      }
      const float pass = segment.pass_probability();
      photon.flux = pass > 0 ? photon.flux * transmittance(medium->sigma_t, length) / pass : Spectrum(0);
    } else if (medium != nullptr) {
      photon.flux *= transmittance(medium->sigma_t, length);
    }
    if (!found || is_black(photon.flux)) return;
    const scene::SurfaceInteraction surface = scene.interaction(photon.ray, hit);
    if (photon.depth > 0 && may_scatter(photon.depth) && world_->bsdf(hit.shape).has_smooth_lobes()) {
      photons.on_surfaces.push_back({surface.position, photon.ray.direction, surface.geometric_normal,
                                     photon.flux, photon.depth, path});
    }
    if (!scatter_at_surface(photon, surface, random)) return;
  }
}

}  // namespace fogbank::transport
