// Eight floats or four doubles at a time, in GCC's vector types: arithmetic, comparisons and `?:` work lane
// by lane, and targets without 256-bit registers get the same results from narrower ones.
#pragma once

#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>

namespace fogbank::derivatives {

template <typename Real>
struct SimdOf {
  static constexpr size_t lanes = 32 / sizeof(Real);
  typedef Real Type __attribute__((vector_size(32)));
};
template <typename Real>
using Simd = typename SimdOf<Real>::Type;
template <typename Real>
inline constexpr size_t simd_lanes = SimdOf<Real>::lanes;

/// a b + c, rounded once. Written out, as the compiler may not contract a * b + c by itself.
template <typename Real>
inline Simd<Real> multiply_add(const Simd<Real>& a, const Simd<Real>& b, const Simd<Real>& c) {
  Simd<Real> result;
  for (size_t i = 0; i < simd_lanes<Real>; ++i) result[i] = std::fma(a[i], b[i], c[i]);
  return result;
}

/// Angle of (x, y) in [-pi, pi], as std::atan2 but for signed zeros: the angle of (0, 0) is 0 and that of (x,
/// 0) with x < 0 is pi. Largest error over all finite arguments whose quotients are normal numbers: 3 ulp.
/// Reduction to |angle| <= pi/8 as in Cephes; the polynomials are minimax in relative error (2.1e-8, 3.6e-17;
/// from tests/numerics/make_arctangent.py).
template <typename Real>
inline Simd<Real> arctangent(const Simd<Real>& y, const Simd<Real>& x) {
  constexpr bool is_float = sizeof(Real) == 4;
  const Simd<Real> zero{};
  const Simd<Real> size_y = y < zero ? -y : y;
  const Simd<Real> size_x = x < zero ? -x : x;
  // tan(pi/8): below it the angle is atan(y/x), above 1/tan(pi/8) it is pi/2 - atan(x/y), between them
  // pi/4 + atan((y-x)/(y+x)).
  const Real low = Real(0.41421356237309504880L);
  const auto is_flat = size_y <= low * size_x;
  const auto is_steep = size_x < low * size_y;
  const Simd<Real> one = zero + Real(1);
  const Simd<Real> numerator = is_flat ? size_y : (is_steep ? -size_x : size_y - size_x);
  const Simd<Real> denominator = is_flat ? size_x : (is_steep ? size_y : size_y + size_x);
  const Simd<Real> t = numerator / (denominator > zero ? denominator : one);
  const Simd<Real> z = t * t;
  Simd<Real> p = zero;
  if constexpr (is_float) {
    constexpr std::array<float, 4> c{-0.333329491517f, 0.199777103396f, -0.138776811504f, 0.0805372855944f};
    for (size_t i = c.size(); i-- > 0;) p = multiply_add<Real>(p, z, zero + c[i]);
  } else {
    constexpr std::array<double, 10> c{
        -0.33333333333330150596,  0.19999999999088948966,  -0.14285714195261828344,  0.11111106653627955746,
        -0.090907824135760389895, 0.076900683163733586988, -0.066411213209764171419, 0.056925396028096522247,
        -0.043590968106147185161, 0.021259860965258011202};
    for (size_t i = c.size(); i-- > 0;) p = multiply_add<Real>(p, z, zero + c[i]);
  }
  // Multiples of pi/4 as a rounded number and the rest of it.
  constexpr Real quarter = Real(0.78539816339744830962L);
  constexpr Real quarter_rest = is_float ? Real(-2.1855695000931213e-8L) : Real(3.0616169978683829e-17L);
  const Simd<Real> multiple = is_flat ? zero : (is_steep ? one + one : one);
  Simd<Real> angle = multiply_add<Real>(p * z, t, multiple * quarter_rest) + t + multiple * quarter;
  angle = x < zero ? (4 * quarter - angle) + 4 * quarter_rest : angle;
  return y < zero ? -angle : angle;
}

}  // namespace fogbank::derivatives
