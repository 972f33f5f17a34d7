// Elementary functions of fields, where a field is a plain value or a jet: the same formula then gives a
// value, or the value with its exact derivatives.
#pragma once

#include <cmath>
#include <concepts>

#include "core/vector.h"
#include "derivatives/jet.h"

namespace fogbank::derivatives::flatland {

template <typename Field>
concept ScalarField = std::same_as<Field, double> || std::same_as<Field, Jet2d>;

template <ScalarField Field>
Field linear_field(double value, const Vec2d& gradient) {
  if constexpr (std::same_as<Field, double>) {
    return value;
  } else {
    return Jet2d::linear(value, gradient);
  }
}

inline double value_of(double field) { return field; }
inline double value_of(const Jet2d& field) { return field.value; }

/// f(g) from f and its first two derivatives at g.
inline double compose(double /*g*/, double f, double /*f1*/, double /*f2*/) { return f; }
inline Jet2d compose(const Jet2d& g, double f, double f1, double f2) { return chain(g, f, f1, f2); }

template <ScalarField Field>
Field reciprocal(const Field& g) {
  const double inverse = 1 / value_of(g);
  return compose(g, inverse, -inverse * inverse, 2 * inverse * inverse * inverse);
}

/// exp(-g)
template <ScalarField Field>
Field decay(const Field& g) {
  const double value = std::exp(-value_of(g));
  return compose(g, value, -value, value);
}

template <ScalarField Field>
Field cosine(const Field& g) {
  const double c = std::cos(value_of(g));
  return compose(g, c, -std::sin(value_of(g)), -c);
}

template <ScalarField Field>
Field sine(const Field& g) {
  const double s = std::sin(value_of(g));
  return compose(g, s, std::cos(value_of(g)), -s);
}

/// 1 / cos(g)
template <ScalarField Field>
Field secant(const Field& g) {
  const double s = 1 / std::cos(value_of(g));
  const double t = std::tan(value_of(g));
  return compose(g, s, s * t, s * (1 + 2 * t * t));
}

/// f(a, b) for a scalar function with the jet `f` at (a, b).
inline Jet2d compose(const Jet2d& f, const Jet2d& a, const Jet2d& b) {
  using Matrix = Jet2d::Matrix;
  return {f.value, f.gradient.x * a.gradient + f.gradient.y * b.gradient,
          f.gradient.x * a.hessian + f.gradient.y * b.hessian + f.hessian(0, 0) * Matrix::outer(a.gradient) +
              f.hessian(1, 1) * Matrix::outer(b.gradient) +
              f.hessian(0, 1) * Matrix::outer_sum(a.gradient, b.gradient)};
}

/// Angle of the vector (cosine part, sine part) = (b, a): atan2(a, b).
inline double angle(double a, double b) { return std::atan2(a, b); }
inline Jet2d angle(const Jet2d& a, const Jet2d& b) {
  const double square = a.value * a.value + b.value * b.value;
  const double fa = b.value / square;
  const double fb = -a.value / square;
  return compose({std::atan2(a.value, b.value), {fa, fb}, {{2 * fa * fb, fb * fb - fa * fa, -2 * fa * fb}}},
                 a, b);
}

}  // namespace fogbank::derivatives::flatland
