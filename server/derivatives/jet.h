// A scalar field's second-order Taylor expansion at a point, and its arithmetic: what every term of a
// record's derivatives is expressed in.
#pragma once

#include <cstdint>

#include "core/symmetric.h"

namespace fogbank::derivatives {

/// Value first, derivatives on demand: what isn't asked for isn't computed.
enum class DerivativeOrder : uint8_t { value, gradient, hessian };

/// f(x + d) = value + gradient . d + d^T hessian d / 2 + O(|d|^3). Units: those of f, per length, per length
/// squared. Exact under the operations below (product and chain rules), so a closed form may be written as
/// arithmetic on jets.
template <typename Real, int Dim>
struct Jet {
  using Vector = glm::vec<Dim, Real>;
  using Matrix = Symmetric<Real, Dim>;

  Real value = 0;
  Vector gradient{0};
  Matrix hessian{};

  static Jet constant(Real c) { return {c, Vector(0), {}}; }
  /// The linear field direction . x, with value `at` here.
  static Jet linear(Real at, const Vector& direction) { return {at, direction, {}}; }

  Jet& operator+=(const Jet& other) {
    value += other.value;
    gradient += other.gradient;
    hessian += other.hessian;
    return *this;
  }
  Jet& operator-=(const Jet& other) {
    value -= other.value;
    gradient -= other.gradient;
    hessian -= other.hessian;
    return *this;
  }
  Jet& operator*=(Real scale) {
    value *= scale;
    gradient *= scale;
    hessian *= scale;
    return *this;
  }
  friend Jet operator+(Jet a, const Jet& b) { return a += b; }
  friend Jet operator-(Jet a, const Jet& b) { return a -= b; }
  friend Jet operator*(Jet a, Real scale) { return a *= scale; }
  friend Jet operator*(Real scale, Jet a) { return a *= scale; }
  /// Product rule (method.md section 5): g h, g grad h + h grad g, ...
  friend Jet operator*(const Jet& g, const Jet& h) {
    return {g.value * h.value, g.value * h.gradient + h.value * g.gradient,
            g.value * h.hessian + h.value * g.hessian + Matrix::outer_sum(g.gradient, h.gradient)};
  }
  /// f(g) for a scalar function with value f, first derivative f1 and second derivative f2 at g.value.
  friend Jet chain(const Jet& g, Real f, Real f1, Real f2) {
    return {f, f1 * g.gradient, f1 * g.hessian + f2 * Matrix::outer(g.gradient)};
  }
};

using Jet3d = Jet<double, 3>;
using Jet2d = Jet<double, 2>;

}  // namespace fogbank::derivatives
