// Random closed surroundings of a point: what virtual triangulations look like, without tracing rays.
#pragma once

#include <array>
#include <cmath>
#include <cstdint>
#include <glm/gtc/matrix_transform.hpp>
#include <map>
#include <utility>
#include <vector>

#include "core/random.h"
#include "core/vector.h"

namespace fogbank::test {

/// Directions (unit length) and distances of vertices seen from a point, and a closed triangulation of them,
/// counter-clockwise from inside except where the jitter turned a triangle over.
struct Surroundings {
  std::vector<Vec3d> directions;
  std::vector<double> distances;
  std::vector<std::array<uint32_t, 3>> triangles;

  Vec3d position(uint32_t i) const { return directions[i] * distances[i]; }
};

inline double uniform(RandomStream& random, double low, double high) {
  // Two numbers, for all bits of a double.
  const double fine = static_cast<double>(random.next_uint()) * 0x1p-32;
  return low + (high - low) * (static_cast<double>(random.next_uint()) + fine) * 0x1p-32;
}

inline Vec3d uniform_direction(RandomStream& random) {
  const double z = uniform(random, -1, 1);
  const double phi = uniform(random, 0, 2 * M_PI);
  const double radius = std::sqrt(1 - z * z);
  return {radius * std::cos(phi), radius * std::sin(phi), z};
}

/// Octahedron, each triangle cut into four `levels` times, randomly turned, each direction moved by up to
/// `jitter` of a radian, distances log-uniform in [nearest, farthest].
inline Surroundings closed_surroundings(RandomStream& random, int levels, double jitter, double nearest,
                                        double farthest) {
  Surroundings result;
  result.directions = {{1, 0, 0}, {-1, 0, 0}, {0, 1, 0}, {0, -1, 0}, {0, 0, 1}, {0, 0, -1}};
  result.triangles = {{0, 2, 4}, {2, 1, 4}, {1, 3, 4}, {3, 0, 4}, {2, 0, 5}, {1, 2, 5}, {3, 1, 5}, {0, 3, 5}};
  for (int level = 0; level < levels; ++level) {
    std::map<std::pair<uint32_t, uint32_t>, uint32_t> middles;
    const auto middle = [&](uint32_t a, uint32_t b) {
      const auto key = std::minmax(a, b);
      const auto [place, is_new] = middles.try_emplace(key, static_cast<uint32_t>(result.directions.size()));
      if (is_new) result.directions.push_back(glm::normalize(result.directions[a] + result.directions[b]));
      return place->second;
    };
    std::vector<std::array<uint32_t, 3>> finer;
    for (const auto& [a, b, c] : result.triangles) {
      const uint32_t ab = middle(a, b);
      const uint32_t bc = middle(b, c);
      const uint32_t ca = middle(c, a);
      finer.insert(finer.end(), {{a, ab, ca}, {ab, b, bc}, {ca, bc, c}, {ab, bc, ca}});
    }
    result.triangles = std::move(finer);
  }
  const glm::dmat3 turn(glm::rotate(glm::dmat4(1), uniform(random, 0, 2 * M_PI), uniform_direction(random)));
  for (Vec3d& direction : result.directions) {
    direction = glm::normalize(turn * direction + uniform(random, 0, jitter) * uniform_direction(random));
    result.distances.push_back(nearest * std::pow(farthest / nearest, uniform(random, 0, 1)));
  }
  return result;
}

}  // namespace fogbank::test
