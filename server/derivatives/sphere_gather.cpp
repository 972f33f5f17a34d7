#include "derivatives/sphere_gather.h"

#include <algorithm>
#include <cmath>

#include "derivatives/sphere_mesh.h"

namespace fogbank::derivatives {

namespace {

/// Bisections of an outline (method.md section 17).
constexpr int32_t outline_steps = 4;
/// Least distance to a surface in radii of the scene: below it single precision no longer tells points apart.
constexpr float least_radii = 1e-7f;
/// The triangulation is trusted as far as its own value is within this factor of the mean.
constexpr double most_ratio = 2;

void keep_finite(Jet3d& jet) {
  bool finite = std::isfinite(jet.value);
  for (int i = 0; i < 3; ++i) finite = finite && std::isfinite(jet.gradient[i]);
  for (const double entry : jet.hessian.entries) finite = finite && std::isfinite(entry);
  if (!finite) jet = Jet3d::constant(std::isfinite(jet.value) ? jet.value : 0);
}

Jet3d to_double(const Jet<float, 3>& jet) {
  Jet3d result{jet.value, Vec3d(jet.gradient), {}};
  for (size_t i = 0; i < jet.hessian.entries.size(); ++i) result.hessian.entries[i] = jet.hessian.entries[i];
  return result;
}

/// Transmittance of the piece by which a vertex is farther away than its ray's end (nearer: the inverse).
Spectrum extend(const Spectrum& weight, const Spectrum& sigma_t, float extra) {
  Spectrum result(0);
  for (int c = 0; c < 3; ++c)
    if (weight[c] > 0 && std::isfinite(extra))
      result[c] = static_cast<float>(static_cast<double>(weight[c]) *
                                     std::exp(-static_cast<double>(sigma_t[c]) * static_cast<double>(extra)));
  return result;
}

}  // namespace

SphereGather::SphereGather(std::shared_ptr<const transport::World> world, const EstimatorSettings& settings)
    : world_(std::move(world)), settings_(settings) {}

void SphereGather::trace(const Vec3f& x, int32_t medium, RandomStream& random, SphereSamples& samples,
                         RayCounters& counters) const {
  const int32_t n = DirectionTopology::side_for(settings_.samples);
  samples.rays.trace(x, medium, n, random, counters);
  if (!settings_.emission) samples.rays.forget_emitted();
  samples.outlines.points.clear();
  samples.outlines.of_edge.assign(samples.rays.topology().edges().size(), Outlines::none);
  samples.radiance.assign(samples.rays.ends().size(), Spectrum(0));
  samples.light.assign(samples.rays.ends().size(), Vec3d(0));
  samples.arriving.assign(samples.rays.ends().size(), 0);
  samples.medium_variance = {};
}

void SphereGather::find_outlines(SphereSamples& samples, RayCounters& counters) const {
  if (settings_.derivatives == DerivativeOrder::value) return;
  const auto ends = samples.rays.ends();
  const bool lit = settings_.order != Order::multiple;
  std::vector<float> weights(ends.size());
  for (size_t i = 0; i < ends.size(); ++i)
    weights[i] = luminance(lit ? ends[i].weight * (samples.radiance[i] + ends[i].emitted) : ends[i].weight);
  samples.outlines = derivatives::find_outlines(samples.rays.lines(), ends, samples.rays.topology().edges(),
                                                weights, settings_.bisect ? outline_steps : 0,
                                                ends.size() / static_cast<size_t>(outline_steps), counters);
}

void SphereGather::sample_radiance(const SurfaceSource& source, RandomStream& random, SphereSamples& samples,
                                   RayCounters& counters) const {
  const SphereRays& rays = samples.rays;
  // Rays that see no surface leave their samples to the others.
  const std::vector<Spectrum> leaving = surface_radiance(
      *world_, source, rays.hits(), static_cast<int32_t>(rays.ends().size()), random, counters);
  for (size_t i = 0; i < leaving.size(); ++i) samples.radiance[rays.rays_of_hits()[i]] = leaving[i];
}

RadianceJet SphereGather::gather(const SphereSamples& samples, const RayCounters& counters) const {
  const SphereRays& rays = samples.rays;
  const Sightlines& lines = rays.lines();
  const auto ends = rays.ends();
  Vec3d mean(0);
  for (size_t i = 0; i < ends.size(); ++i)
    mean += Vec3d(ends[i].weight * (samples.radiance[i] + ends[i].emitted));
  mean /= static_cast<double>(ends.size());
  RadianceJet result;
  for (size_t c = 0; c < 3; ++c) result.channels[c].value = mean[static_cast<int>(c)];
  if (settings_.derivatives == DerivativeOrder::value || mean == Vec3d(0)) return result;

  std::vector<uint32_t> surfaces(ends.size());
  for (size_t i = 0; i < ends.size(); ++i) surfaces[i] = ends[i].surface;
  counters.poll();
  std::vector<Spectrum> radiance =
      filter_over_neighbours(samples.radiance, rays.topology().neighbours(), surfaces);
  std::vector<uint8_t> lit(ends.size());
  for (size_t i = 0; i < ends.size(); ++i) {
    radiance[i] += ends[i].emitted;
    lit[i] = is_black(radiance[i] * ends[i].weight) ? 0 : 1;
  }
  counters.poll();
  const SphereMesh mesh = make_sphere_mesh(
      {lines.directions(), ends, rays.topology().triangles(), rays.topology().triangle_edges()},
      samples.outlines, lit, least_radii * world_->scene().bounds.radius, counters);
  const auto form_factors =
      gather_form_factors<float>(mesh.vertices, mesh.triangles, settings_.derivatives, counters);

  const int32_t medium = lines.medium();
  const Spectrum sigma_t = medium == scene::none ? Spectrum(0) : world_->medium(medium).sigma_t;
  std::vector<Spectrum> weights(mesh.vertices.size(), Spectrum(0));
  RadianceJet triangulated;
  for (size_t v = 0; v < mesh.vertices.size(); ++v) {
    counters.poll_at(v);
    const uint32_t ray = mesh.rays[v];
    if (lit[ray] == 0) continue;
    const RayEnd& end = ends[ray];
    const float closeness = mesh.vertices[v].inverse_distance();
    const bool crosses = !end.is_mirrored && lines.changes_medium(ray);
    if (crosses) {
      // The jet of a transmittance that is not one exponential: double precision, vertex by vertex.
      const MediaPath path = lines.path(ray);
      const Vec3d direction(mesh.vertices[v].direction());
      const RadianceJet through = closeness > 0 ? path.towards(direction / static_cast<double>(closeness))
                                                : path.towards_infinity(direction);
      const Jet3d form_factor = to_double(form_factors[v].jet());
      for (size_t c = 0; c < 3; ++c)
        triangulated.channels[c] +=
            through.channels[c] * form_factor * static_cast<double>(radiance[ray][static_cast<int>(c)]);
      continue;
    }
    weights[v] = radiance[ray] * end.weight;
    if (v >= ends.size() && closeness > 0)
      weights[v] = extend(weights[v], sigma_t, 1 / closeness - end.distance);
  }
  triangulated +=
      gather_radiance<float>(mesh.vertices, form_factors, weights, sigma_t, settings_.derivatives, counters);

  const double value = triangulated.luminance().value;
  const double ratio =
      value > 0 ? std::clamp(result.luminance().value / value, 1 / most_ratio, most_ratio) : 1.0;
  for (size_t c = 0; c < 3; ++c) {
    Jet3d& channel = triangulated.channels[c];
    channel *= ratio;
    channel.value = result.channels[c].value;
    keep_finite(channel);
  }
  return triangulated;
}

}  // namespace fogbank::derivatives
