// An integrator that is a function given by the test.
#pragma once

#include <functional>
#include <memory>
#include <utility>

#include "core/ray_counters.h"
#include "integrators/integrator.h"
#include "render/render_job.h"
#include "render/render_to_image.h"

namespace fogbank::render {

class FunctionIntegrator final : public integrators::Integrator {
 public:
  using Function = std::function<Spectrum(const Ray&, RandomStream&, RayCounters&)>;

  explicit FunctionIntegrator(Function function) : function_(std::move(function)) {}
  integrators::PixelSample sample(const Ray& ray, RandomStream& random,
                                  RayCounters& counters) const override {
    return {.sampled = function_(ray, random, counters)};
  }

 private:
  Function function_;
};

inline std::unique_ptr<FunctionIntegrator> function_integrator(FunctionIntegrator::Function function) {
  return std::make_unique<FunctionIntegrator>(std::move(function));
}

/// Depends on everything that a radiance may depend on: the ray, and a number of random numbers that differs
/// from sample to sample.
inline Spectrum ray_and_random_function(const Ray& ray, RandomStream& random, RayCounters& counters) {
  Spectrum sum = glm::abs(ray.direction);
  const int terms = 1 + static_cast<int>(8 * random.next_float());
  for (int i = 0; i < terms; ++i) {
    sum += 1e3f * Spectrum(random.next_float(), random.next_float(), random.next_float()) / (1.0f + sum);
    ++counters.closest_hit;
  }
  return sum;
}

inline RenderSettings small_settings(int32_t width, int32_t height, int32_t samples_per_pixel) {
  RenderSettings settings;
  settings.film.width = width;
  settings.film.height = height;
  settings.film.crop = {0, 0, width, height};
  settings.samples_per_pixel = samples_per_pixel;
  settings.tile_size = 16;
  return settings;
}

inline Image render_function(const RenderSettings& settings, int threads,
                             FunctionIntegrator::Function function = ray_and_random_function) {
  RenderJob job(function_integrator(std::move(function)), settings);
  run_to_completion(job, threads);
  return job.image();
}

}  // namespace fogbank::render
