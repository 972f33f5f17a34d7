#include "scene/scene_builders.h"

namespace fogbank::scene::test {

Mesh globe(int rings, int segments) {
  Mesh mesh;
  mesh.positions.push_back({0, 0, 1});
  for (int ring = 1; ring < rings; ++ring) {
    const float theta = pi * static_cast<float>(ring) / static_cast<float>(rings);
    for (int segment = 0; segment < segments; ++segment) {
      const float phi = 2 * pi * static_cast<float>(segment) / static_cast<float>(segments);
      mesh.positions.push_back(
          {std::sin(theta) * std::cos(phi), std::sin(theta) * std::sin(phi), std::cos(theta)});
    }
  }
  mesh.positions.push_back({0, 0, -1});
  const auto last = static_cast<uint32_t>(mesh.positions.size() - 1);
  const auto n = static_cast<uint32_t>(segments);
  for (uint32_t s = 0; s < n; ++s) {
    const uint32_t t = (s + 1) % n;
    mesh.triangles.push_back({0, 1 + s, 1 + t});
    for (uint32_t ring = 0; ring + 2 < static_cast<uint32_t>(rings); ++ring) {
      const uint32_t upper = 1 + ring * n;
      const uint32_t lower = upper + n;
      mesh.triangles.push_back({upper + s, lower + s, lower + t});
      mesh.triangles.push_back({upper + s, lower + t, upper + t});
    }
    const uint32_t lowest = 1 + static_cast<uint32_t>(rings - 2) * n;
    mesh.triangles.push_back({last, lowest + t, lowest + s});
  }
  return mesh;
}

}  // namespace fogbank::scene::test
