#include "derivatives/correlated_light.h"

#include <algorithm>
#include <cmath>
#include <optional>

#include "core/sampling.h"
#include "derivatives/random_at.h"

namespace fogbank::derivatives {

namespace {

/// Batches are the sub-lattices of 4 x 4 cells.
constexpr int32_t batch_side = 4;
/// More boundaries than this along a direction end it: a guard against surfaces that coincide.
constexpr int most_boundaries = 256;
/// Streams of directions begin here, behind those of other uses.
constexpr uint32_t first_stream = 16;

}  // namespace

CorrelatedLight::CorrelatedLight(const transport::World& world, const transport::Plan& plan,
                                 const transport::PathTracer& paths, int32_t directions, const Vec3f& around,
                                 uint64_t seed, uint32_t repeat)
    : world_(world),
      plan_(plan),
      paths_(paths),
      side_(batch_side * std::max(1, static_cast<int32_t>(std::lround(
                                         std::sqrt(static_cast<double>(directions)) / batch_side)))),
      around_(around),
      seed_(seed),
      repeat_(repeat) {}

ValueBatches CorrelatedLight::at(const Vec3d& x, int32_t medium, RayCounters& counters) const {
  ValueBatches batches(static_cast<size_t>(batch_side * batch_side), Vec3d(0));
  const bool sphere = plan_.reflected() || plan_.mirrors() || plan_.shells();
  const float share = 1.0f / static_cast<float>(side_);
  const Vec3f at(x);
  for (int32_t j = 0; j < side_; ++j) {
    counters.poll();
    for (int32_t i = 0; i < side_; ++i) {
      RandomStream random =
          random_at(around_, seed_, repeat_, first_stream + static_cast<uint32_t>(j * side_ + i));
      const Vec2f jitter = random.next_vec2();
      const Vec2f u = glm::min((Vec2f(i, j) + jitter) * share, Vec2f(one_minus_epsilon));
      const float u_distance = random.next_float();
      Spectrum value = from_environments(at, medium, u, counters);
      if (sphere)
        value += from_direction(at, medium, square_to_uniform_sphere(u), u_distance, random, counters);
      if (is_finite(value))
        batches[static_cast<size_t>((j % batch_side) * batch_side + i % batch_side)] += Vec3d(value);
    }
  }
  const double scale = static_cast<double>(batches.size()) / (static_cast<double>(side_) * side_);
  for (Vec3d& batch : batches) batch *= scale;
  return batches;
}

Spectrum CorrelatedLight::from_environments(const Vec3f& x, int32_t medium, const Vec2f& u,
                                            RayCounters& counters) const {
  Spectrum sum(0);
  for (const uint32_t index : world_.environments()) {
    if (plan_.treatment(index) == transport::LightTreatment::left_out) continue;
    const std::optional<transport::LightSample> sample = world_.lights().light(index).sample(x, u);
    if (sample && !is_black(sample->radiance))
      sum += sample->radiance * (inv_4pi / sample->pdf) *
             world_.visibility(x, sample->direction, sample->distance, medium, counters);
  }
  return sum;
}

Spectrum CorrelatedLight::from_direction(const Vec3f& x, int32_t medium, const Vec3f& direction,
                                         float u_distance, RandomStream& random,
                                         RayCounters& counters) const {
  const scene::Scene& scene = world_.scene();
  Ray ray{x, direction, infinity};
  Spectrum through(1);
  Spectrum sum(0);
  for (int passed = 0; passed < most_boundaries && !is_black(through); ++passed) {
    scene::Hit hit;
    ++counters.closest_hit;
    const bool found = scene.intersector->intersect(ray, hit);
    if (medium != scene::none && plan_.shells() && !is_black(world_.medium(medium).sigma_s)) {
      // A distance by the mean extinction, at the same quantile everywhere.
      const transport::MediumInfo& info = world_.medium(medium);
      const float length = found ? hit.distance : infinity;
      const float opacity = -std::expm1(-info.mean_sigma_t * length);
      const float t = -std::log1p(-u_distance * opacity) / info.mean_sigma_t;
      const float pdf = info.mean_sigma_t * std::exp(-info.mean_sigma_t * t) / opacity;
      const Spectrum weight = through * info.sigma_s * transport::transmittance(info.sigma_t, t) / pdf;
      if (pdf > 0 && is_finite(weight))
        sum +=
            weight * paths_.light_in_medium(ray.at(t), ray.direction, medium, 1, random, counters).scattered;
    }
    if (!found) break;
    if (medium != scene::none)
      through *= transport::transmittance(world_.medium(medium).sigma_t, hit.distance);
    const scene::SurfaceInteraction surface = scene.interaction(ray, hit);
    if (!world_.is_null(hit.shape)) {
      if (plan_.reflected() || plan_.mirrors())
        sum += through * paths_.scattered_radiance(surface, direction, medium, 1, random, counters);
      break;
    }
    medium = world_.medium_beyond(surface, direction, medium);
    ray.origin = surface.spawn_origin(direction);
  }
  return sum;
}

}  // namespace fogbank::derivatives
