#include "core/sobol.h"

#include <algorithm>
#include <array>
#include <bit>

namespace fogbank {

namespace {

constexpr int bits = 32;
using DirectionNumbers = std::array<uint32_t, bits>;

/// The lowest bit first: what the hash below works on.
constexpr uint32_t reversed(uint32_t x) {
  x = (x >> 16) | (x << 16);
  x = ((x & 0xFF00FF00u) >> 8) | ((x & 0x00FF00FFu) << 8);
  x = ((x & 0xF0F0F0F0u) >> 4) | ((x & 0x0F0F0F0Fu) << 4);
  x = ((x & 0xCCCCCCCCu) >> 2) | ((x & 0x33333333u) << 2);
  return ((x & 0xAAAAAAAAu) >> 1) | ((x & 0x55555555u) << 1);
}

/// Direction numbers (reversed) of the primitive polynomial of `degree` with inner coefficients `inner`, from
/// the first ones m (Bratley and Fox 1988, "Algorithm 659", equation 3).
constexpr DirectionNumbers direction_numbers(int degree, uint32_t inner, std::array<uint32_t, 2> m) {
  DirectionNumbers v{};
  for (int i = 0; i < bits; ++i) {
    const auto k = static_cast<size_t>(i);
    if (degree == 0) {
      v[k] = 1u << (bits - 1 - i);
    } else if (i < degree) {
      v[k] = m[k] << (bits - 1 - i);
    } else {
      const uint32_t oldest = v[k - static_cast<size_t>(degree)];
      v[k] = oldest ^ (oldest >> degree);
      for (int j = 1; j < degree; ++j)
        if ((inner >> (degree - 1 - j) & 1u) != 0) v[k] ^= v[k - static_cast<size_t>(j)];
    }
  }
  for (uint32_t& number : v) number = reversed(number);
  return v;
}

constexpr std::array<DirectionNumbers, sobol_dimensions> numbers{
    direction_numbers(0, 0, {}), direction_numbers(1, 0, {1}), direction_numbers(2, 1, {1, 3})};

/// Laine and Karras 2011: each bit is flipped by a hash of the lower ones.
constexpr uint32_t hashed(uint32_t x, uint32_t scramble) {
  x += scramble;
  x ^= x * 0x6C50B47Cu;
  x ^= x * 0xB82F1E52u;
  x ^= x * 0xC7AFE638u;
  return x ^ x * 0x8D22F6E6u;
}

constexpr float canonical(uint32_t x) { return static_cast<float>(x >> 8) * 0x1p-24f; }

}  // namespace

float scrambled_sobol(uint32_t index, uint32_t dimension, uint32_t scramble) {
  uint32_t x = 0;
  for (uint32_t rest = index; rest != 0; rest &= rest - 1)
    x ^= numbers[dimension][static_cast<size_t>(std::countr_zero(rest))];
  return canonical(reversed(hashed(x, scramble)));
}

void scrambled_sobol(uint32_t first, uint32_t dimension, uint32_t scramble, std::span<float> values) {
  constexpr uint32_t block = 16;
  std::array<uint32_t, block> x;
  const DirectionNumbers& v = numbers[dimension];
  for (size_t begin = 0; begin < values.size(); begin += block) {
    const uint32_t start = first + static_cast<uint32_t>(begin);
    const int width = std::bit_width(start | (start + block - 1));
    x.fill(0);
    for (int bit = 0; bit < width; ++bit) {
      const uint32_t number = v[static_cast<size_t>(bit)];
      for (uint32_t i = 0; i < block; ++i) x[i] ^= number & (0u - ((start + i) >> bit & 1u));
    }
    for (uint32_t& value : x) value = reversed(hashed(value, scramble));
    const size_t count = std::min<size_t>(block, values.size() - begin);
    for (size_t i = 0; i < count; ++i) values[begin + i] = canonical(x[i]);
  }
}

}  // namespace fogbank
