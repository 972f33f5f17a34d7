// Counter-based random numbers: a number is a pure function of (seed, pixel, sample, position in the stream),
// so a pixel is the same whichever thread, tile or worker computes it.
#pragma once

#include <array>
#include <cstdint>

#include "core/vector.h"

namespace fogbank {

/// Philox4x32 with 7 rounds (Salmon et al. 2011, "Parallel Random Numbers: As Easy as 1, 2, 3", table 2: 7
/// rounds is the least that passes BigCrush): maps a 128-bit counter and a 64-bit key to 128 random bits.
std::array<uint32_t, 4> philox4x32(std::array<uint32_t, 4> counter, std::array<uint32_t, 2> key);

/// Stream of independent canonical random numbers of one sample of one pixel.
class RandomStream {
 public:
  /// `stream` tells apart uses that must be independent at the same pixel and sample (camera path, records,
  /// ...).
  RandomStream(uint64_t seed, uint32_t pixel_x, uint32_t pixel_y, uint32_t sample, uint32_t stream = 0);

  /// Uniform in [0, 1), 24 bits.
  float next_float() {
    if (used_ == 4) refill();
    return static_cast<float>(block_[used_++] >> 8) * 0x1p-24f;
  }
  Vec2f next_vec2() {
    const float x = next_float();
    return {x, next_float()};
  }
  uint32_t next_uint() {
    if (used_ == 4) refill();
    return block_[used_++];
  }

  /// Number of the sample among those of its pixel.
  uint32_t sample() const { return counter_[1]; }
  /// 128 random bits that all samples of the pixel share which ask at the same position in their streams:
  /// selects the sequence that those samples take points from. Discards what is left of the present block.
  std::array<uint32_t, 4> next_shared();

 private:
  void refill();

  std::array<uint32_t, 4> counter_;  ///< (block, sample, pixel x, pixel y)
  std::array<uint32_t, 2> key_;
  std::array<uint32_t, 4> block_{};
  uint32_t used_ = 4;
};

}  // namespace fogbank
