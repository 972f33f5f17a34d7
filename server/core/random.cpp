#include "core/random.h"

namespace fogbank {

std::array<uint32_t, 4> philox4x32(std::array<uint32_t, 4> counter, std::array<uint32_t, 2> key) {
  constexpr uint64_t multiplier_0 = 0xD2511F53u;
  constexpr uint64_t multiplier_1 = 0xCD9E8D57u;
  constexpr uint32_t weyl_0 = 0x9E3779B9u;
  constexpr uint32_t weyl_1 = 0xBB67AE85u;
  for (int round = 0; round < 7; ++round) {
    const uint64_t product_0 = multiplier_0 * counter[0];
    const uint64_t product_1 = multiplier_1 * counter[2];
    counter = {static_cast<uint32_t>(product_1 >> 32) ^ counter[1] ^ key[0], static_cast<uint32_t>(product_1),
               static_cast<uint32_t>(product_0 >> 32) ^ counter[3] ^ key[1],
               static_cast<uint32_t>(product_0)};
    key[0] += weyl_0;
    key[1] += weyl_1;
  }
  return counter;
}

RandomStream::RandomStream(uint64_t seed, uint32_t pixel_x, uint32_t pixel_y, uint32_t sample,
                           uint32_t stream)
    : counter_{0, sample, pixel_x, pixel_y} {
  // The key mixes seed and stream through the cipher itself, so that neighbouring seeds and streams share no
  // structure.
  const auto mixed =
      philox4x32({static_cast<uint32_t>(seed), static_cast<uint32_t>(seed >> 32), stream, 0x464F4742u},
                 {0x24B4C0DEu, 0x5EED5EEDu});
  key_ = {mixed[0], mixed[1]};
}

void RandomStream::refill() {
  block_ = philox4x32(counter_, key_);
  ++counter_[0];
  used_ = 0;
}

std::array<uint32_t, 4> RandomStream::next_shared() {
  // Apart from all blocks of samples by the key.
  constexpr uint32_t shared = 0x53484152u;
  const std::array<uint32_t, 4> bits =
      philox4x32({counter_[0], 0, counter_[2], counter_[3]}, {key_[0] ^ shared, key_[1]});
  ++counter_[0];
  used_ = 4;
  return bits;
}

}  // namespace fogbank
