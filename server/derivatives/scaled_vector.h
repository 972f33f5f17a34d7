// Vectors taken apart into a power of two and a part of size 1, so that products of many lengths neither
// overflow nor underflow (method.md section 12, "Extremes").
#pragma once

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstdint>
#include <limits>
#include <type_traits>

#include "core/vector.h"

namespace fogbank::derivatives {

/// Distances below this (2^-59 in float, 2^-507 in double) have no derivatives that a Real could hold: terms
/// with such a distance are left out, so that every result is finite.
template <typename Real>
Real smallest_distance() {
  return std::ldexp(Real(1), std::numeric_limits<Real>::min_exponent / 2 + 3);
}

/// Largest power of two that isn't above x, a normal number > 0.
template <typename Real>
Real power_of_two_below(Real x) {
  if constexpr (std::is_same_v<Real, float>)
    return std::bit_cast<float>(std::bit_cast<uint32_t>(x) & 0x7f800000u);
  else if constexpr (std::is_same_v<Real, double>)
    return std::bit_cast<double>(std::bit_cast<uint64_t>(x) & 0x7ff0000000000000u);
  else
    return std::ldexp(Real(1), std::ilogb(x));
}

/// r = mantissa / scale. `scale` is a power of two, hence `mantissa` is exact and 1 <= max |component| < 2.
/// All zero for |r| < smallest_distance().
template <typename Real, int Dim>
struct ScaledVector {
  using Vector = glm::vec<Dim, Real>;

  Vector mantissa{0};
  Real scale = 0;
  Real inverse_norm = 0;  ///< 1 / |mantissa|

  explicit ScaledVector(const Vector& r) {
    Real largest = 0;
    for (int i = 0; i < Dim; ++i) largest = std::max(largest, std::abs(r[i]));
    if (!(largest >= smallest_distance<Real>())) return;
    scale = 1 / power_of_two_below(largest);
    mantissa = r * scale;
    inverse_norm = 1 / std::sqrt(glm::dot(mantissa, mantissa));
  }
  Vector unit() const { return mantissa * inverse_norm; }
  Real inverse_length() const { return scale * inverse_norm; }
};

/// a b - c d with both products taken exactly, so that cancellation costs no digits; antisymmetric to the bit
/// under (a, b) <-> (c, d).
template <typename Real>
Real difference_of_products(Real a, Real b, Real c, Real d) {
  const Real left = a * b;
  const Real right = c * d;
  return (left - right) + (std::fma(a, b, -left) - std::fma(c, d, -right));
}

template <typename Real>
Real cross(const glm::vec<2, Real>& a, const glm::vec<2, Real>& b) {
  return difference_of_products(a.x, b.y, a.y, b.x);
}

/// a x b to a few ulp in each component, also for nearly parallel vectors.
template <typename Real>
glm::vec<3, Real> cross(const glm::vec<3, Real>& a, const glm::vec<3, Real>& b) {
  return {difference_of_products(a.y, b.z, a.z, b.y), difference_of_products(a.z, b.x, a.x, b.z),
          difference_of_products(a.x, b.y, a.y, b.x)};
}

}  // namespace fogbank::derivatives
