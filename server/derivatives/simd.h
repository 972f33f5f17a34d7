// Eight floats or four doubles at a time, in GCC's vector types: arithmetic, comparisons and `?:` work lane
// by lane, and targets without 256-bit registers get the same results from narrower ones.
#pragma once

#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <cstring>
#if defined(__AVX2__) && defined(__FMA__)
#include <immintrin.h>
#endif

namespace fogbank::derivatives {

template <typename Real>
struct SimdOf {
  static constexpr size_t lanes = 32 / sizeof(Real);
  typedef Real Type __attribute__((vector_size(32)));
};
template <typename Real>
using Simd = SimdOf<Real>::Type;
template <typename Real>
inline constexpr size_t simd_lanes = SimdOf<Real>::lanes;

/// a b + c, rounded once. Spelt out for AVX2, as compilers may not contract a * b + c (-ffp-contract=off) and
/// don't always find the vector instruction for a loop over lanes.
template <typename Real>
inline Simd<Real> multiply_add(const Simd<Real>& a, const Simd<Real>& b, const Simd<Real>& c) {
#if defined(__AVX2__) && defined(__FMA__)
  if constexpr (sizeof(Real) == 4)
    return _mm256_fmadd_ps(a, b, c);
  else
    return _mm256_fmadd_pd(a, b, c);
#else
  Simd<Real> result;
  for (size_t i = 0; i < simd_lanes<Real>; ++i) result[i] = std::fma(a[i], b[i], c[i]);
  return result;
#endif
}

/// Swaps registers and lanes: register i, lane j <-> register j, lane i.
inline std::array<Simd<double>, 4> transpose(const std::array<Simd<double>, 4>& rows) {
  const auto low = [](Simd<double> a, Simd<double> b) { return __builtin_shufflevector(a, b, 0, 4, 2, 6); };
  const auto high = [](Simd<double> a, Simd<double> b) { return __builtin_shufflevector(a, b, 1, 5, 3, 7); };
  const Simd<double> even_a = low(rows[0], rows[1]);
  const Simd<double> even_b = low(rows[2], rows[3]);
  const Simd<double> odd_a = high(rows[0], rows[1]);
  const Simd<double> odd_b = high(rows[2], rows[3]);
  return {
      __builtin_shufflevector(even_a, even_b, 0, 1, 4, 5), __builtin_shufflevector(odd_a, odd_b, 0, 1, 4, 5),
      __builtin_shufflevector(even_a, even_b, 2, 3, 6, 7), __builtin_shufflevector(odd_a, odd_b, 2, 3, 6, 7)};
}

/// The same within each half of four lanes: of rows (a b c d | e f g h), the first result has the four a,
/// then the four e.
inline std::array<Simd<float>, 4> transpose_halves(const std::array<Simd<float>, 4>& rows) {
  const auto low = [](Simd<float> a, Simd<float> b) {
    return __builtin_shufflevector(a, b, 0, 8, 1, 9, 4, 12, 5, 13);
  };
  const auto high = [](Simd<float> a, Simd<float> b) {
    return __builtin_shufflevector(a, b, 2, 10, 3, 11, 6, 14, 7, 15);
  };
  // Interleaving first with third and second with fourth, then the two.
  const Simd<float> low_even = low(rows[0], rows[2]);
  const Simd<float> low_odd = low(rows[1], rows[3]);
  const Simd<float> high_even = high(rows[0], rows[2]);
  const Simd<float> high_odd = high(rows[1], rows[3]);
  return {low(low_even, low_odd), high(low_even, low_odd), low(high_even, high_odd),
          high(high_even, high_odd)};
}

inline std::array<Simd<float>, 8> transpose(const std::array<Simd<float>, 8>& rows) {
  const auto first = transpose_halves({rows[0], rows[1], rows[2], rows[3]});
  const auto second = transpose_halves({rows[4], rows[5], rows[6], rows[7]});
  std::array<Simd<float>, 8> columns;
  for (size_t i = 0; i < 4; ++i) {
    columns[i] = __builtin_shufflevector(first[i], second[i], 0, 1, 2, 3, 8, 9, 10, 11);
    columns[i + 4] = __builtin_shufflevector(first[i], second[i], 4, 5, 6, 7, 12, 13, 14, 15);
  }
  return columns;
}

/// Four components of an item a lane.
template <typename Real>
using Quad = std::array<Real, 4>;

/// Component c of `items[lane]` in lane `lane` of register c.
inline std::array<Simd<double>, 4> load_quads(const std::array<const Quad<double>*, 4>& items) {
  std::array<Simd<double>, 4> rows;
  for (size_t lane = 0; lane < 4; ++lane) std::memcpy(&rows[lane], items[lane]->data(), sizeof(Simd<double>));
  return transpose(rows);
}
inline std::array<Simd<float>, 4> load_quads(const std::array<const Quad<float>*, 8>& items) {
  typedef float Half __attribute__((vector_size(16)));
  std::array<Simd<float>, 4> rows;
  for (size_t lane = 0; lane < 4; ++lane) {
    Half low;
    Half high;
    std::memcpy(&low, items[lane]->data(), sizeof(Half));
    std::memcpy(&high, items[lane + 4]->data(), sizeof(Half));
    rows[lane] = __builtin_shufflevector(low, high, 0, 1, 2, 3, 4, 5, 6, 7);
  }
  return transpose_halves(rows);
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
