// Cheap approximations for importances, where an error of 1e-4 costs nothing. Never for values that enter a picture.
#pragma once

#include <cmath>

#include "core/vector.h"

namespace fogbank {

/// atan(x), absolute error below 1.2e-5: odd minimax polynomial of degree 9 on [-1, 1] (Abramowitz and Stegun 4.4.47),
/// atan(x) = pi/2 - atan(1/x) beyond. No branch, so that calls in a row overlap; glibc's takes 5 times as long.
inline float fast_atan(float x) {
  const float magnitude = std::fabs(x);
  const bool large = magnitude > 1.0f;
  const float z = large ? 1.0f / magnitude : magnitude;
  const float s = z * z;
  const float polynomial = z * (0.9998660f + s * (-0.3302995f + s * (0.1801410f + s * (-0.0851330f + s * 0.0208351f))));
  return std::copysign(large ? 0.5f * pi - polynomial : polynomial, x);
}

}  // namespace fogbank
