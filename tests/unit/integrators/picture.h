// Small pictures straight from an integrator, without jobs: preparation by rounds, then samples pixel by
// pixel.
#pragma once

#include <algorithm>
#include <atomic>
#include <functional>
#include <memory>
#include <numeric>
#include <thread>
#include <vector>

#include "integrators/integrator.h"
#include "scene/intersector.h"
#include "scene/scene.h"

namespace fogbank::integrators::test {

/// The scene's sensor with a film of another size and a box filter.
class TestCamera final : public CameraRays {
 public:
  TestCamera(const scene::Sensor& sensor, int32_t width, int32_t height) : sensor_(sensor) {
    film_.width = width;
    film_.height = height;
    film_.crop = {0, 0, width, height};
    film_.filter = scene::ReconstructionFilter::box;
    film_.filter_radius = 0.5f;
  }

  Ray sample(uint32_t x, uint32_t y, RandomStream& random) const override {
    const Vec2f position = Vec2f(static_cast<float>(x) + 0.5f, static_cast<float>(y) + 0.5f) +
                           scene::sample_filter_offset(film_, random.next_vec2());
    return sensor_.sample_ray(film_, position, random.next_vec2());
  }
  scene::Window window() const override { return film_.crop; }
  Vec2i film_size() const override { return {film_.width, film_.height}; }
  Vec3f position() const override { return Vec3f(Vec3d(sensor_.to_world[3])); }
  float pixel_angle() const override {
    return 2 * static_cast<float>(sensor_.half_width(film_)) / static_cast<float>(film_.width);
  }

 private:
  scene::Sensor sensor_;
  scene::Film film_;
};

/// Calls task(i) for all i < count on `threads` threads; on one: in descending order, as any order must do.
inline void run_tasks(uint32_t count, int threads, const std::function<void(uint32_t)>& task) {
  if (threads == 1) {
    for (uint32_t i = count; i-- > 0;) task(i);
    return;
  }
  std::atomic<uint32_t> next = 0;
  std::vector<std::jthread> pool;
  for (int i = 0; i < threads; ++i)
    pool.emplace_back([&] {
      scene::prepare_render_thread();
      for (uint32_t number = next++; number < count; number = next++) task(number);
    });
}

/// Runs what `integrator` wants to have done for the camera.
inline void prepare(Integrator& integrator, const CameraRays& camera, const CacheTarget& target,
                    int threads) {
  scene::prepare_render_thread();
  const std::unique_ptr<Preparation> preparation = integrator.prepare(camera, target);
  while (preparation) {
    const uint32_t tasks = preparation->next_round();
    if (tasks == 0) break;
    run_tasks(tasks, threads, [&](uint32_t task) {
      RayCounters counters;
      preparation->run(task, counters);
    });
  }
}

/// Row by row; means over `samples`, with the variances of the means of luminance.
struct Picture {
  std::vector<Spectrum> mean;
  std::vector<double> variance;
};

inline Picture take(const Integrator& integrator, const CameraRays& camera, uint32_t samples, int threads) {
  const scene::Window window = camera.window();
  const auto width = static_cast<uint32_t>(window.width);
  const auto height = static_cast<uint32_t>(window.height);
  Picture picture{std::vector<Spectrum>(size_t{width} * height), std::vector<double>(size_t{width} * height)};
  run_tasks(height, threads, [&](uint32_t y) {
    RayCounters counters;
    for (uint32_t x = 0; x < width; ++x) {
      Vec3d sum(0);
      double first = 0;
      double second = 0;
      for (uint32_t i = 0; i < samples; ++i) {
        RandomStream random(0, x, y, i);
        const Ray ray = camera.sample(x, y, random);
        const PixelSample sample = integrator.sample(ray, random, counters);
        const Spectrum radiance = sample.sampled + sample.cached;
        sum += Vec3d(radiance);
        first += static_cast<double>(luminance(radiance));
        second += static_cast<double>(sqr(luminance(radiance)));
      }
      const double n = samples;
      picture.mean[size_t{y} * width + x] = Spectrum(sum / n);
      picture.variance[size_t{y} * width + x] =
          samples > 1 ? std::max(second / n - first / n * (first / n), 0.0) / (n - 1) : 0.0;
    }
  });
  return picture;
}

}  // namespace fogbank::integrators::test
