// Real spherical harmonics of degrees 1 to 3: what is left of light that came from all sides when a broad
// phase function has smoothed it.
#pragma once

#include <array>
#include <cstddef>

#include "core/vector.h"

namespace fogbank {

inline constexpr int harmonic_degrees = 3;
/// 3 of degree 1, 5 of degree 2, 7 of degree 3.
inline constexpr size_t harmonic_count = 15;

constexpr int degree_of_harmonic(size_t index) { return index < 3 ? 1 : index < 8 ? 2 : 3; }

/// sqrt(4 pi) Y_lm of a unit direction, l ascending, within it m = -l..l (polynomials as in Sloan 2008,
/// "Stupid Spherical Harmonics Tricks", appendix A2). The one of degree 0, left out, would be 1; each has a
/// mean square of 1 over the sphere, and the squares of a degree add up to 2 l + 1 in any direction.
inline std::array<float, harmonic_count> spherical_harmonics(const Vec3f& direction) {
  const float x = direction.x;
  const float y = direction.y;
  const float z = direction.z;
  constexpr float sqrt_3 = 1.7320508f;
  constexpr float sqrt_15 = 3.8729833f;
  constexpr float half_sqrt_5 = 1.1180340f;
  constexpr float half_sqrt_7 = 1.3228757f;
  constexpr float sqrt_35_8 = 2.0916501f;
  constexpr float sqrt_105 = 10.246951f;
  constexpr float sqrt_21_8 = 1.6201852f;
  const float five = 5 * z * z - 1;
  return {sqrt_3 * y,
          sqrt_3 * z,
          sqrt_3 * x,
          sqrt_15 * x * y,
          sqrt_15 * y * z,
          half_sqrt_5 * (3 * z * z - 1),
          sqrt_15 * x * z,
          0.5f * sqrt_15 * (x * x - y * y),
          sqrt_35_8 * y * (3 * x * x - y * y),
          sqrt_105 * x * y * z,
          sqrt_21_8 * y * five,
          half_sqrt_7 * z * (5 * z * z - 3),
          sqrt_21_8 * x * five,
          0.5f * sqrt_105 * z * (x * x - y * y),
          sqrt_35_8 * x * (x * x - 3 * y * y)};
}

}  // namespace fogbank
