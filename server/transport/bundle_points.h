// Parts of estimators that take several samples at once.
#pragma once

#include <array>
#include <span>

#include "core/random.h"
#include "core/sobol.h"
#include "transport/world.h"

namespace fogbank::transport {

/// Most samples of a bundle.
inline constexpr int32_t most_bundle_samples = 64;
inline constexpr auto bundle_capacity = static_cast<size_t>(most_bundle_samples);

/// Points of the pixel's sequence, ascending in `first`.
class BundlePoints {
 public:
  BundlePoints(int32_t samples, RandomStream& random) : count_(static_cast<size_t>(samples)) {
    const std::array<uint32_t, 4> scrambles = random.next_shared();
    const uint32_t start = random.sample() * static_cast<uint32_t>(samples);
    std::array<std::array<float, bundle_capacity>, 3> values;
    for (uint32_t dimension = 0; dimension < 3; ++dimension)
      scrambled_sobol(start, dimension, scrambles[dimension], std::span(values[dimension]).first(count_));
    // One point in each interval of the first coordinate.
    for (size_t i = 0; i < count_; ++i) {
      const auto place = static_cast<size_t>(values[0][i] * static_cast<float>(count_));
      first_[place] = values[0][i];
      others_[place] = {values[1][i], values[2][i]};
    }
  }

  std::span<float> first() { return std::span(first_).first(count_); }
  const Vec2f& others(size_t i) const { return others_[i]; }

 private:
  size_t count_;
  std::array<float, bundle_capacity> first_;
  std::array<Vec2f, bundle_capacity> others_;
};

/// Rays to points of lights with what they would bring.
class ShadowRays {
 public:
  void add(const Ray& ray, const Spectrum& radiance) {
    rays_[count_] = ray;
    radiance_[count_] = radiance;
    ++count_;
  }
  Spectrum trace(const World& world, int32_t medium, RayCounters& counters) const {
    std::array<Spectrum, capacity> visible;
    world.visibility(std::span(rays_).first(count_), medium, visible, counters);
    Spectrum sum(0);
    for (size_t i = 0; i < count_; ++i) sum += radiance_[i] * visible[i];
    return sum;
  }

 private:
  static constexpr size_t capacity = bundle_capacity + LightSampler::most_parallel_lights;

  size_t count_ = 0;
  std::array<Ray, capacity> rays_;
  std::array<Spectrum, capacity> radiance_;
};

}  // namespace fogbank::transport
