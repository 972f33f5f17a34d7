// Low-discrepancy points: Sobol' sequences with Owen scrambling, for integrals of few dimensions of which a
// pixel takes many samples.
#pragma once

#include <cstdint>
#include <span>

namespace fogbank {

/// Dimensions that there are direction numbers for.
inline constexpr uint32_t sobol_dimensions = 3;

/// Coordinate `dimension` (< sobol_dimensions) of points first, first + 1, ... of the Sobol' sequence
/// (direction numbers of Joe and Kuo 2008), scrambled by a nested uniform permutation that `scramble` selects
/// (Burley 2020, "Practical Hash-based Owen Scrambling", section 3). Values are in [0, 1), 24 bits. Any 2^k
/// points whose first number is a multiple of 2^k have one value in each interval [i / 2^k, (i + 1) / 2^k).
/// For a uniformly random `scramble` each value is uniformly distributed.
void scrambled_sobol(uint32_t first, uint32_t dimension, uint32_t scramble, std::span<float> values);
/// The same of one point.
float scrambled_sobol(uint32_t index, uint32_t dimension, uint32_t scramble);

}  // namespace fogbank
