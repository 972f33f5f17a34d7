// Eight records side by side: what one vector instruction tests at a time.
#pragma once

#include <array>
#include <bit>
#include <cmath>
#include <cstddef>
#include <cstdint>

#ifdef __AVX2__
#include <immintrin.h>
#endif

#include "derivatives/simd.h"

namespace fogbank::cache {

inline constexpr uint32_t packet_size = 8;

/// Arithmetic and comparisons are by element (GCC's vector extension).
using Float8 = derivatives::Simd<float>;
using Int8 = derivatives::Simd<int32_t>;

inline Float8 broadcast(float value) { return Float8{} + value; }

/// Bit i set where element i of a comparison's result is true.
inline uint32_t mask_of(Int8 condition) {
#ifdef __AVX2__
  return static_cast<uint32_t>(_mm256_movemask_ps(std::bit_cast<__m256>(condition)));
#else
  uint32_t mask = 0;
  for (uint32_t i = 0; i < packet_size; ++i) mask |= condition[i] != 0 ? 1u << i : 0u;
  return mask;
#endif
}

inline Float8 absolute(Float8 values) {
  return std::bit_cast<Float8>(std::bit_cast<Int8>(values) & 0x7fffffff);
}

/// By element; b where a is NaN.
inline Float8 greater(Float8 a, Float8 b) { return a > b ? a : b; }
inline Float8 lesser(Float8 a, Float8 b) { return a < b ? a : b; }

inline Float8 square_root(Float8 values) {
  for (uint32_t i = 0; i < packet_size; ++i) values[i] = std::sqrt(values[i]);
  return values;
}

/// The places of the bits set in each byte, lowest first, in bytes from the lowest up.
inline constexpr std::array<uint64_t, 256> set_bits = [] {
  std::array<uint64_t, 256> table{};
  for (uint32_t mask = 0; mask < 256; ++mask) {
    uint32_t count = 0;
    for (uint32_t bit = 0; bit < packet_size; ++bit)
      if ((mask >> bit & 1u) != 0) table[mask] |= uint64_t{bit} << 8 * count++;
  }
  return table;
}();

/// Writes base + i for every bit i set in `mask`, ascending, and returns how many. Always touches 8 elements
/// of `out`: free of branches, since which children a point lies in can't be predicted.
inline uint32_t append_set_bits(uint32_t mask, uint32_t base, uint32_t* out) {
#ifdef __AVX2__
  const __m256i bits = _mm256_cvtepu8_epi32(_mm_cvtsi64_si128(static_cast<long long>(set_bits[mask])));
  _mm256_storeu_si256(reinterpret_cast<__m256i*>(out),
                      _mm256_add_epi32(bits, _mm256_set1_epi32(static_cast<int32_t>(base))));
#else
  for (uint32_t i = 0; i < packet_size; ++i) out[i] = base + (set_bits[mask] >> 8 * i & 0xffu);
#endif
  return static_cast<uint32_t>(std::popcount(mask));
}

/// Positions of eight records.
struct PositionPacket {
  std::array<Float8, 3> axes;

  float& at(int axis, uint32_t lane) { return reinterpret_cast<float*>(&axes[axis])[lane]; }
  float at(int axis, uint32_t lane) const { return axes[axis][lane]; }
};

/// |W d|^2 of offsets d, W symmetric with entries as core/symmetric.h packs them: normalised squared distance
/// from the centre of an ellipsoid.
inline Float8 normalised_square(const std::array<Float8, 6>& w, Float8 x, Float8 y, Float8 z) {
  using derivatives::multiply_add;
  const Float8 a = multiply_add<float>(w[0], x, multiply_add<float>(w[1], y, w[2] * z));
  const Float8 b = multiply_add<float>(w[1], x, multiply_add<float>(w[3], y, w[4] * z));
  const Float8 c = multiply_add<float>(w[2], x, multiply_add<float>(w[4], y, w[5] * z));
  return multiply_add<float>(a, a, multiply_add<float>(b, b, c * c));
}

/// W of eight ellipsoids; NaN holds no point.
struct alignas(64) ShapePacket {
  std::array<Float8, 6> entries;
};

}  // namespace fogbank::cache
