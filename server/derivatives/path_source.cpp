#include "derivatives/path_source.h"

#include "derivatives/medium_march.h"
#include "transport/direct_light.h"

namespace fogbank::derivatives {

Spectrum PathTracedSource::in_scattered(const Ray& ray, float length, int32_t medium, RandomStream& random,
                                        RayCounters& counters) const {
  counters.poll();
  const transport::World& world = kernel_->world();
  const transport::MediumInfo& info = world.medium(medium);
  const int32_t max_depth = kernel_->settings().max_depth;
  // The event in the medium is one more, and after it an edge to a light.
  if (is_black(info.sigma_s) || (max_depth >= 0 && depth_ + 1 >= max_depth)) return Spectrum(0);
  const transport::MediumSegment segment{ray.origin, ray.direction, length, &info, Vec3f(1.0f / 3)};
  Spectrum sum = transport::in_scattered_radiance(
      world, segment, medium, 1, transport::EmissionFoundBy::light_sampling, random, counters);
  // Light scattered before, at a distance drawn by transmittance; its direction, drawn by the phase function,
  // has a weight of 1.
  const DistanceSample place =
      sample_stratum(Vec3d(info.sigma_t), 0, static_cast<double>(length), random.next_float());
  if (std::isfinite(place.distance) && place.inverse_pdf > 0) {
    const auto t = static_cast<float>(place.distance);
    const Vec3f direction = info.phase.sample(ray.direction, random.next_vec2()).direction;
    scene::Hit hit;
    sum += info.sigma_s * transport::transmittance(info.sigma_t, t) * static_cast<float>(place.inverse_pdf) *
           kernel_->arriving_radiance({ray.at(t), direction, infinity}, medium, depth_ + 1, random, counters,
                                      &hit);
  }
  return is_finite(sum) ? sum : Spectrum(0);
}

}  // namespace fogbank::derivatives
