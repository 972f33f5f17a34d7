#include "cache/hilbert.h"

#include <algorithm>
#include <array>
#include <cmath>

namespace fogbank::cache {
namespace {

constexpr uint32_t bits = 21;

/// Bit i of `value` to place 3 i.
uint64_t spread(uint64_t value) {
  value = (value | value << 32) & 0x001f00000000ffffu;
  value = (value | value << 16) & 0x001f0000ff0000ffu;
  value = (value | value << 8) & 0x100f00f00f00f00fu;
  value = (value | value << 4) & 0x10c30c30c30c30c3u;
  return (value | value << 2) & 0x1249249249249249u;
}

/// Cell coordinates to the transposed Hilbert index (Skilling 2004, "Programming the Hilbert curve", AIP
/// Conference Proceedings 707, AxestoTranspose).
void to_transposed_index(std::array<uint32_t, 3>& x) {
  for (uint32_t q = 1u << (bits - 1); q > 1; q >>= 1) {
    const uint32_t low = q - 1;
    for (uint32_t& coordinate : x) {
      // Inverts x[0] where the bit is set and swaps where it isn't, without a branch: bits are as good as
      // random.
      const uint32_t inverted = (coordinate & q) != 0 ? low : 0;
      const uint32_t swapped = (x[0] ^ coordinate) & (low ^ inverted);
      x[0] ^= swapped | inverted;
      coordinate ^= swapped;
    }
  }
  x[1] ^= x[0];
  x[2] ^= x[1];
  uint32_t flip = 0;
  for (uint32_t q = 1u << (bits - 1); q > 1; q >>= 1) flip ^= (x[2] & q) != 0 ? q - 1 : 0;
  for (uint32_t& coordinate : x) coordinate ^= flip;
}

}  // namespace

HilbertCurve::HilbertCurve(float extent) {
  int exponent = 0;
  std::frexp(static_cast<double>(extent), &exponent);  // extent < 2^exponent
  cells_per_unit_ = std::ldexp(1.0, static_cast<int>(bits) - 1 - exponent);
}

uint64_t HilbertCurve::index(const Vec3f& position) const {
  std::array<uint32_t, 3> cell{};
  for (int axis = 0; axis < 3; ++axis) {
    const double centre = 1u << (bits - 1);
    const double coordinate = static_cast<double>(position[axis]) * cells_per_unit_ + centre;
    cell[static_cast<size_t>(axis)] = static_cast<uint32_t>(std::clamp(coordinate, 0.0, 2 * centre - 1));
  }
  to_transposed_index(cell);
  return spread(cell[0]) << 2 | spread(cell[1]) << 1 | spread(cell[2]);
}

}  // namespace fogbank::cache
