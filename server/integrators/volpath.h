// Volumetric path tracing: unbiased, the reference for everything else. The kernel is transport::PathTracer.
#pragma once

#include <memory>

#include "integrators/integrator.h"
#include "transport/path_tracer.h"

namespace fogbank::integrators {

class VolumetricPathTracer final : public Integrator {
 public:
  VolumetricPathTracer(std::shared_ptr<const transport::World> world, const IntegratorSettings& settings)
      : kernel_(std::move(world),
                {settings.max_depth, settings.rr_depth, settings.hide_emitters, settings.camera_medium}) {}

  PixelSample sample(const Ray& ray, RandomStream& random, RayCounters& counters) const override {
    return {.sampled = kernel_.radiance(ray, random, counters)};
  }

 private:
  transport::PathTracer kernel_;
};

}  // namespace fogbank::integrators
