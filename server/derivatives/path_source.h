// The medium's own light, path traced.
#pragma once

#include <memory>

#include "derivatives/source.h"
#include "transport/path_tracer.h"

namespace fogbank::derivatives {

class PathTracedSource final : public MediumSource {
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

 private:
  std::shared_ptr<const transport::PathTracer> kernel_;
  int32_t depth_;
};

}  // namespace fogbank::derivatives
