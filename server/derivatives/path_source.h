// Light of medium and surfaces, path traced.
#pragma once

#include <memory>

#include "derivatives/source.h"
#include "transport/path_tracer.h"

namespace fogbank::derivatives {

class PathTracedSource final : public MediumSource, public LineSource, public SurfaceSource {
 public:
  /// `depth`: scattering events between the camera and the points asked for; 1 for a record that the camera
  /// sees.
  PathTracedSource(std::shared_ptr<const transport::PathTracer> kernel, int32_t depth)
      : kernel_(std::move(kernel)), depth_(depth) {}

  Spectrum mean_radiance(const Vec3f& y, int32_t medium, RandomStream& random,
                         RayCounters& counters) const override {
    const Spectrum sample = kernel_->mean_radiance(y, medium, depth_, random, counters);
    return is_finite(sample) ? sample : Spectrum(0);
  }
  transport::MediumLight light(const Vec3f& y, const Vec3f& direction, int32_t medium, RandomStream& random,
                               RayCounters& counters) const override {
    const transport::MediumLight sample =
        kernel_->light_in_medium(y, direction, medium, depth_, random, counters);
    return is_finite(sample.scattered) && is_finite(sample.mean) ? sample : transport::MediumLight{};
  }
  Spectrum leaving_radiance(const SurfaceHit& hit, int32_t samples, RandomStream& random,
                            RayCounters& counters) const override {
    Spectrum sum(0);
    for (int32_t i = 0; i < samples; ++i) {
      const Spectrum sample =
          kernel_->scattered_radiance(hit.surface, hit.direction, hit.medium, depth_, random, counters);
      if (is_finite(sample)) sum += sample;
    }
    return samples > 1 ? sum / static_cast<float>(samples) : sum;
  }

  /// Whatever the medium's phase function.
  Spectrum in_scattered(const Ray& ray, float length, int32_t medium, RandomStream& random,
                        RayCounters& counters) const override;

 private:
  std::shared_ptr<const transport::PathTracer> kernel_;
  int32_t depth_;
};

}  // namespace fogbank::derivatives
