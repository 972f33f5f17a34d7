// Distances to the nearest surface by direction, one byte each (guard 4 of method.md section 10.4): a record
// says nothing about places that it can't see.
#pragma once

#include <array>
#include <bit>
#include <cmath>
#include <cstdint>

#include "core/vector.h"

namespace fogbank::cache {

/// 8 x 8 cells of the octahedral map of the sphere (Cigolle et al. 2014, "A Survey of Efficient
/// Representations for Independent Unit Vectors"). Distances are kept as the exponent and the two leading
/// bits of the mantissa of a float, rounded down: at most 20 % short, from 2^-32 to 1.5 * 2^31 scene units.
/// Shorter ones are 0, longer ones (no surface: infinity) the greatest.
struct DepthBins {
  static constexpr uint32_t resolution = 8;
  static constexpr uint32_t count = resolution * resolution;

  std::array<uint8_t, count> codes = all_open();

  static constexpr std::array<uint8_t, count> all_open() {
    std::array<uint8_t, count> result{};
    result.fill(255);
    return result;
  }

  /// Code of a distance (>= 0) on the scale that has no ends.
  static int32_t logarithm(float distance) {
    return static_cast<int32_t>(std::bit_cast<uint32_t>(distance) >> mantissa_shift) - code_base;
  }
  /// Greatest code whose distance is at most `distance` (>= 0).
  static uint8_t encode(float distance) {
    const int32_t code = logarithm(distance);
    return static_cast<uint8_t>(code < 0 ? 0 : code > 255 ? 255 : code);
  }
  static float decode(uint8_t code) {
    return code == 0 ? 0.0f
                     : std::bit_cast<float>((code + static_cast<uint32_t>(code_base)) << mantissa_shift);
  }

  /// Bin that holds `direction` (any length but 0).
  static uint32_t bin(const Vec3f& direction) {
    const float norm = std::fabs(direction.x) + std::fabs(direction.y) + std::fabs(direction.z);
    const float scale = 1.0f / norm;
    float u = direction.x * scale;
    float v = direction.y * scale;
    if (direction.z < 0) {
      const float folded = u < 0 ? std::fabs(v) - 1.0f : 1.0f - std::fabs(v);
      v = v < 0 ? std::fabs(u) - 1.0f : 1.0f - std::fabs(u);
      u = folded;
    }
    return cell(v) * resolution + cell(u);
  }
  /// Lowers the bin of `direction` to `distance` if that is shorter.
  void insert(const Vec3f& direction, float distance) {
    uint8_t& code = codes[bin(direction)];
    const uint8_t seen = encode(distance);
    if (seen < code) code = seen;
  }
  /// Whether an offset from the record stays in front of what it saw in that direction.
  bool reaches(const Vec3f& offset) const {
    const float distance = std::sqrt(offset.x * offset.x + offset.y * offset.y + offset.z * offset.z);
    return distance == 0 || logarithm(distance) < int32_t{codes[bin(offset)]};
  }

  static constexpr uint32_t mantissa_shift = 21;
  static constexpr int32_t code_base = ((127 - 32) << 2) - 1;  ///< code 1 is 2^-32

  friend bool operator==(const DepthBins&, const DepthBins&) = default;

 private:
  /// Row or column of a coordinate in [-1, 1].
  static uint32_t cell(float coordinate) {
    const auto index = static_cast<int32_t>((coordinate + 1.0f) * (0.5f * resolution));
    return static_cast<uint32_t>(index < 0 ? 0 : index > 7 ? 7 : index);
  }
};

}  // namespace fogbank::cache
