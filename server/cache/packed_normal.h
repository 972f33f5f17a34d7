// Unit vectors in 32 bits: the octahedral map of the sphere (Cigolle et al. 2014, "A Survey of Efficient
// Representations for Independent Unit Vectors"), 16 bits a coordinate, at most 7e-5 radians off.
#pragma once

#include <cmath>
#include <cstdint>
#include <cstdlib>
#include <utility>

#include "core/vector.h"

namespace fogbank::cache {

/// The vector 0, and that vector only.
inline constexpr uint32_t no_normal = 0xffffffffu;

namespace octahedral {

/// Coordinates are -half to half, kept as 0 to 2 half: exact on the axes, and 0xffff is left for no_normal.
inline constexpr int32_t half = 32767;

/// Between the octahedron's upper half and its lower one, which lies around it in the map.
template <typename T>
std::pair<T, T> fold(T u, T v, T one) {
  return {(one - std::abs(v)) * (u < 0 ? -1 : 1), (one - std::abs(u)) * (v < 0 ? -1 : 1)};
}

}  // namespace octahedral

/// `normal`: 0, or of any finite length.
inline uint32_t pack_normal(const Vec3f& normal) {
  const float norm = std::fabs(normal.x) + std::fabs(normal.y) + std::fabs(normal.z);
  if (norm == 0) return no_normal;
  std::pair<float, float> point(normal.x / norm, normal.y / norm);
  if (normal.z < 0) point = octahedral::fold(point.first, point.second, 1.0f);
  const auto quantize = [](float coordinate) {
    return static_cast<uint32_t>(std::lrint(coordinate * octahedral::half) + octahedral::half);
  };
  return quantize(point.first) | quantize(point.second) << 16;
}

/// Unit vector, or 0. Packed and unpacked again it has the same bits: in whole numbers all points of the map
/// that stand for a direction give the same vector.
inline Vec3f unpack_normal(uint32_t packed) {
  if (packed == no_normal) return Vec3f(0);
  std::pair<int32_t, int32_t> point(static_cast<int32_t>(packed & 0xffffu) - octahedral::half,
                                    static_cast<int32_t>(packed >> 16) - octahedral::half);
  const int32_t height = octahedral::half - std::abs(point.first) - std::abs(point.second);
  if (height < 0) point = octahedral::fold(point.first, point.second, octahedral::half);
  return glm::normalize(Vec3f(point.first, point.second, height));
}

}  // namespace fogbank::cache
