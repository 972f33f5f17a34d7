// Cheap approximations for importances, where an error of 1e-4 costs nothing. Never for values that enter a
// picture.
#pragma once

#include <bit>
#include <cmath>
#include <cstdint>

#include "core/vector.h"

namespace fogbank {

/// atan(x), absolute error below 1.2e-5: odd minimax polynomial of degree 9 on [-1, 1] (Abramowitz and
/// Stegun 4.4.47), atan(x) = pi/2 - atan(1/x) beyond. No branch, so that calls in a row overlap; glibc's
/// takes 5 times as long.
inline float fast_atan(float x) {
  const float magnitude = std::fabs(x);
  const bool large = magnitude > 1.0f;
  const float z = large ? 1.0f / magnitude : magnitude;
  const float s = z * z;
  const float polynomial =
      z * (0.9998660f + s * (-0.3302995f + s * (0.1801410f + s * (-0.0851330f + s * 0.0208351f))));
  return std::copysign(large ? 0.5f * pi - polynomial : polynomial, x);
}

/// exp(x) for x <= 0, relative error below 3e-5, 0 below -87: 2^n by the exponent's bits times a polynomial
/// of degree 4 for 2^f on [-1/2, 1/2] (Taylor series). Branch-free: loops over it vectorise.
inline float fast_exp_negative(float x) {
  const float clamped = x > -87.0f ? x : -87.0f;
  const float y = clamped * 1.44269504089f;
  const float n = std::floor(y + 0.5f);
  const float f = (y - n) * 0.69314718056f;
  const float power = 1.0f + f * (1.0f + f * (0.5f + f * (0.16666667f + f * 0.041666667f)));
  const float scale = std::bit_cast<float>((static_cast<int32_t>(n) + 127) << 23);
  return x > -87.0f ? power * scale : 0.0f;
}

}  // namespace fogbank
