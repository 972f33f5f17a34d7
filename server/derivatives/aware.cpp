#include "derivatives/aware.h"

#include <algorithm>
#include <cmath>

#include "derivatives/medium_rays.h"
#include "derivatives/plan_request.h"
#include "derivatives/random_at.h"

namespace fogbank::derivatives {

namespace {

enum Stream : uint32_t { light_stream, ray_stream, radiance_stream, medium_stream };

/// Records see the medium and surfaces after one scattering event: at x, on the way to the camera.
constexpr int32_t source_depth = 1;

/// Where infinity is, in radii of the scene (method.md section 7).
constexpr double far_radii = 1e4f;

/// All jumps in depth between neighbouring rays; those that were not bisected are taken to be at the near
/// ray.
std::vector<RayOutline> ray_outlines(const SphereSamples& samples, double far_distance) {
  const Sightlines& lines = samples.rays.lines();
  std::vector<RayOutline> result;
  const auto add = [&](const Outline& outline) {
    const auto crossings = lines.crossings(outline.far);
    const float first_end =
        std::min(outline.far_distance, crossings.empty() ? infinity : crossings.front().distance);
    const Vec3d direction(outline.direction);
    result.push_back(
        {outline.near, outline.far, direction * static_cast<double>(outline.near_distance),
         direction * (std::isfinite(first_end) ? static_cast<double>(first_end) : far_distance)});
  };
  for (size_t e = 0; e < samples.outlines.of_edge.size(); ++e) {
    const uint32_t index = samples.outlines.of_edge[e];
    if (index < Outlines::unknown) {
      add(samples.outlines.points[index]);
    } else if (index == Outlines::unknown) {
      const DirectionTopology::Edge& edge = samples.rays.topology().edges()[e];
      const bool a_near = lines.distance(edge.a) <= lines.distance(edge.b);
      const uint32_t near = a_near ? edge.a : edge.b;
      const uint32_t far = a_near ? edge.b : edge.a;
      add({near, far, lines.direction(near), lines.distance(near), lines.distance(far)});
    }
  }
  return result;
}

}  // namespace

Aware::Aware(std::shared_ptr<const transport::World> world, const EstimatorSettings& settings)
    : world_(std::move(world)),
      settings_(settings),
      plan_(*world_, plan_request(settings)),
      lights_(*world_, plan_, settings),
      sphere_(world_, settings),
      paths_(std::make_shared<transport::PathTracer>(
                 world_, transport::PathSettings{.max_depth = settings.max_depth}),
             source_depth) {}

RadianceJet Aware::estimate(const Vec3f& x, uint32_t repeat, RayCounters& counters) const {
  SphereSamples samples(*world_, plan_);
  return estimate_from({paths_, paths_}, x, world_->medium_at(x), repeat, samples, counters);
}

RadianceJet Aware::estimate_from(const LightSources& sources, const Vec3f& x, int32_t medium, uint32_t repeat,
                                 SphereSamples& samples, RayCounters& counters) const {
  RadianceJet sum;
  // Camera, x, light: two edges.
  if (settings_.emission && settings_.order != Order::multiple &&
      (settings_.max_depth < 0 || settings_.max_depth >= 2)) {
    RandomStream random = random_at(x, settings_.seed, repeat, light_stream);
    lights_.add(x, medium, random, sum, counters);
  }
  if (!plan_.sphere_grid()) return sum;
  RandomStream ray_random = random_at(x, settings_.seed, repeat, ray_stream);
  sphere_.trace(x, medium, ray_random, samples, counters);
  if (settings_.order != Order::multiple) {
    RandomStream random = random_at(x, settings_.seed, repeat, radiance_stream);
    sphere_.sample_radiance(sources.surfaces, random, samples, counters);
  }
  sphere_.find_outlines(samples, counters);
  if (settings_.order != Order::multiple) {
    sum += sphere_.gather(samples, counters);
    const auto ends = samples.rays.ends();
    for (size_t i = 0; i < ends.size(); ++i) {
      const Spectrum arriving = ends[i].weight * (samples.radiance[i] + ends[i].emitted);
      samples.light[i] += Vec3d(arriving);
      samples.arriving[i] += static_cast<double>(luminance(arriving));
    }
  }
  if (plan_.shells()) {
    RandomStream random = random_at(x, settings_.seed, repeat, medium_stream);
    add_medium(sources.medium, x, samples, random, sum, counters);
  }
  return sum;
}

void Aware::add_medium(const MediumSource& source, const Vec3f& x, SphereSamples& samples,
                       RandomStream& random, RadianceJet& sum, RayCounters& counters) const {
  const std::vector<MediumRay> rays = medium_rays(samples.rays.lines(), counters);
  counters.poll();
  const std::vector<RayOutline> outlines =
      ray_outlines(samples, far_radii * static_cast<double>(world_->scene().bounds.radius));
  std::vector<Vec3d> arriving(rays.size(), Vec3d(0));
  sum += MediumGather(*world_, source)
             .gather(x, rays, samples.rays.topology().triangles(), outlines, settings_.derivatives, random,
                     counters, arriving, &samples.medium_variance);
  for (size_t i = 0; i < arriving.size(); ++i) {
    samples.light[i] += arriving[i];
    for (size_t c = 0; c < 3; ++c)
      samples.arriving[i] += luminance_weights[c] * arriving[i][static_cast<int>(c)];
  }
}

}  // namespace fogbank::derivatives
