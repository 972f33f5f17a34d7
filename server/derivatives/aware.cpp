#include "derivatives/aware.h"

#include <cmath>

#include "derivatives/path_source.h"
#include "derivatives/plan_request.h"
#include "derivatives/random_at.h"

namespace fogbank::derivatives {

namespace {

enum Stream : uint32_t { light_stream, ray_stream, radiance_stream, medium_stream };

/// Records see the medium and surfaces after one scattering event: at x, on the way to the camera.
constexpr int32_t source_depth = 1;

/// Where infinity is, in radii of the scene (method.md section 7).
constexpr float far_radii = 1e4f;

MediumRay medium_ray(const Sightlines& lines, size_t line, uint32_t surface) {
  MediumRay ray;
  ray.direction = Vec3d(lines.direction(line));
  ray.end = lines.distance(line);
  ray.surface = lines.is_blocked(line) ? surface : MediumRay::no_surface;
  MediumStretch stretch;
  stretch.medium = lines.medium();
  for (const Crossing& crossing : lines.crossings(line)) {
    stretch.end = crossing.distance;
    ray.stretches.push_back(stretch);
    stretch = {crossing.medium, crossing.distance, 0, Vec3d(crossing.normal), crossing.through};
  }
  stretch.end = ray.end;
  ray.stretches.push_back(stretch);
  return ray;
}

}  // namespace

Aware::Aware(std::shared_ptr<const transport::World> world, const EstimatorSettings& settings)
    : world_(std::move(world)),
      settings_(settings),
      plan_(*world_, plan_request(settings)),
      lights_(*world_, settings),
      sphere_(world_, plan_, settings),
      source_(std::make_unique<PathTracedSource>(
          std::make_shared<transport::PathTracer>(world_,
                                                  transport::PathSettings{.max_depth = settings.max_depth}),
          source_depth)),
      medium_(*world_, *source_) {}

RadianceJet Aware::estimate(const Vec3f& x, uint32_t repeat, RayCounters& counters) const {
  const int32_t medium = world_->medium_at(x);
  RadianceJet sum;
  if (settings_.order != Order::multiple) {
    RandomStream random = random_at(x, settings_.seed, repeat, light_stream);
    lights_.add(x, medium, random, sum, counters);
  }
  if (!plan_.sphere_grid()) return sum;
  SphereSamples samples(*world_, plan_);
  RandomStream ray_random = random_at(x, settings_.seed, repeat, ray_stream);
  sphere_.trace(x, medium, ray_random, samples, counters);
  if (settings_.order != Order::multiple) {
    RandomStream random = random_at(x, settings_.seed, repeat, radiance_stream);
    sphere_.sample_radiance(random, samples, counters);
    sum += sphere_.gather(samples);
  }
  if (plan_.shells()) {
    RandomStream random = random_at(x, settings_.seed, repeat, medium_stream);
    add_medium(x, samples, random, sum, counters);
  }
  return sum;
}

void Aware::add_medium(const Vec3f& x, const SphereSamples& samples, RandomStream& random, RadianceJet& sum,
                       RayCounters& counters) const {
  const Sightlines& lines = samples.rays.lines();
  std::vector<MediumRay> rays;
  rays.reserve(lines.size());
  for (size_t i = 0; i < lines.size(); ++i)
    rays.push_back(medium_ray(lines, i, samples.rays.ends()[i].surface));
  std::vector<RayOutline> outlines;
  outlines.reserve(samples.outlines.points.size());
  for (const Outline& outline : samples.outlines.points) {
    const Vec3d direction(outline.direction);
    const float behind = std::isfinite(outline.far_distance) ? outline.far_distance
                                                             : far_radii * world_->scene().bounds.radius;
    outlines.push_back({outline.near, outline.far, direction * static_cast<double>(outline.near_distance),
                        direction * static_cast<double>(behind)});
  }
  sum += medium_.gather(x, rays, samples.rays.topology().triangles(), outlines, settings_.derivatives, random,
                        counters);
}

}  // namespace fogbank::derivatives
