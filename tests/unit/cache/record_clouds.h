// Sets of records with extents of known size, for tests and benchmarks of the cache.
#pragma once

#include <tbb/parallel_for.h>

#include <cmath>
#include <vector>

#include "cache/metric.h"
#include "cache/record.h"
#include "core/random.h"
#include "core/sampling.h"

namespace fogbank::cache::test {

/// How records lie in the unit cube: everywhere alike, or nine in ten about thin sheets, as penumbrae make
/// them; `filled` is uniform with radii spread as in caches that fills made (standard deviations of their
/// logarithm: 0.13 to 0.42 in components of scenes/glow and scenes/penumbra).
enum class Layout { uniform, sheets, filled };

/// Random proper rotation: columns are orthonormal.
inline std::array<Vec3f, 3> random_frame(RandomStream& random) {
  const Vec3f z = square_to_uniform_sphere(random.next_vec2());
  const Vec3f helper = square_to_uniform_sphere(random.next_vec2());
  const Vec3f x =
      glm::normalize(glm::cross(std::fabs(glm::dot(helper, z)) < 0.9f ? helper : Vec3f(z.y, z.z, z.x), z));
  return {x, glm::cross(z, x), z};
}

/// Settings under which the records of make_cloud have the extents that it promises.
inline MetricSettings cloud_settings() {
  MetricSettings settings;
  settings.threshold = 1e-3;
  settings.radiance_floor = 1;
  settings.reference = Reference::constant;
  settings.maximum_radius = 0.5;
  return settings;
}

/// `count` records of the linear field 1 + x/2 + y/4 + z/8 (so that no guard finds a contradiction), of which
/// about `overlap` hold a point: Hessians are those of ellipsoids with that mean radius, up to 3:1, at random
/// angles.
inline std::vector<Record> make_cloud(Layout layout, size_t count, double overlap, uint64_t seed) {
  constexpr int sheets = 16;
  constexpr float deviation = 0.02f;
  constexpr double radius_spread = 0.3;
  RandomStream layout_random(seed, 0, 0, 0, 1);
  std::array<Vec3f, sheets> normals;
  std::array<float, sheets> offsets;
  for (size_t i = 0; i < sheets; ++i) {
    normals[i] = square_to_uniform_sphere(layout_random.next_vec2());
    const Vec3f through(layout_random.next_float(), layout_random.next_float(), layout_random.next_float());
    offsets[i] = glm::dot(normals[i], through);
  }
  const auto density = [&](const Vec3f& p) {
    if (layout != Layout::sheets) return 1.0;
    double sum = 0.1;
    for (size_t i = 0; i < sheets; ++i) {
      const double distance =
          static_cast<double>(glm::dot(normals[i], p) - offsets[i]) / static_cast<double>(deviation);
      sum += 0.9 / sheets * std::exp(-distance * distance / 2) / (2.5066 * static_cast<double>(deviation));
    }
    return sum;
  };
  std::vector<Record> records(count);
  tbb::parallel_for(size_t{0}, count, [&](size_t number) {
    RandomStream random(seed, static_cast<uint32_t>(number), static_cast<uint32_t>(number >> 32), 0);
    Record& record = records[number];
    const bool in_sheet = layout == Layout::sheets && random.next_float() < 0.9f;
    const auto sheet = static_cast<size_t>(random.next_float() * sheets);
    do {
      for (int axis = 0; axis < 3; ++axis) record.position[axis] = random.next_float();
      if (!in_sheet) break;
      const float gaussian =
          std::sqrt(-2 * std::log(1 - random.next_float())) * std::cos(2 * pi * random.next_float());
      const float distance = glm::dot(normals[sheet], record.position) - offsets[sheet];
      record.position += (gaussian * deviation - distance) * normals[sheet];
    } while (min_component(record.position) < 0 || max_component(record.position) > 1);
    record.id = content_id(record.position, record.component, "cloud", number);
    record.radiance = Spectrum(1 + record.position.x / 2 + record.position.y / 4 + record.position.z / 8);
    record.gradient.fill({0.5f, 0.25f, 0.125f});
    record.samples = 1024;
    // Walls are the faces of the cube.
    for (int i = 0; i < 256; ++i) {
      const Vec3f direction = square_to_uniform_sphere(random.next_vec2());
      float distance = infinity;
      for (int axis = 0; axis < 3; ++axis) {
        const float along = direction[axis];
        const float to_wall = along > 0 ? 1 - record.position[axis] : -record.position[axis];
        if (along != 0) distance = std::min(distance, to_wall / along);
      }
      record.depth.insert(direction, distance);
    }
    double radius = std::cbrt(3 * overlap /
                              (4 * 3.14159265358979 * static_cast<double>(count) * density(record.position)));
    if (layout == Layout::filled) {
      const double gaussian = std::sqrt(-2 * std::log(1 - static_cast<double>(random.next_float()))) *
                              std::cos(2 * 3.14159265358979 * static_cast<double>(random.next_float()));
      // Volumes keep their mean.
      radius *= std::exp(radius_spread * (gaussian - 1.5 * radius_spread));
    }
    const double curvature = 15 * cloud_settings().threshold / (2 * 3.14159265358979 * std::pow(radius, 5));
    Vec3f shares;
    for (int k = 0; k < 3; ++k) shares[k] = 0.15f + random.next_float();
    shares /= shares.x + shares.y + shares.z;
    const std::array<Vec3f, 3> frame = random_frame(random);
    for (int k = 0; k < 3; ++k)
      record.hessian +=
          static_cast<float>(curvature) * shares[k] * Symmetric3f::outer(frame[static_cast<size_t>(k)]);
  });
  return records;
}

}  // namespace fogbank::cache::test
