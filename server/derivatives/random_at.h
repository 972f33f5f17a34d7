// Random numbers of one estimate at one point.
#pragma once

#include <bit>

#include "core/random.h"

namespace fogbank::derivatives {

/// Stream number `stream` of the `repeat`-th estimate at x: different everywhere, the same always.
inline RandomStream random_at(const Vec3f& x, uint64_t seed, uint32_t repeat, uint32_t stream) {
  const std::array<uint32_t, 4> place = philox4x32(
      {std::bit_cast<uint32_t>(x.x), std::bit_cast<uint32_t>(x.y), std::bit_cast<uint32_t>(x.z), repeat},
      {0x70726F62u, 0x65617478u});
  return {seed ^ (static_cast<uint64_t>(place[3]) << 32), place[0], place[1], place[2], stream};
}

}  // namespace fogbank::derivatives
