// Form factor of a segment in flatland: signed angle / 2 pi, with gradient and Hessian (method.md section 3).
#pragma once

#include <numbers>

#include "derivatives/jet.h"
#include "derivatives/scaled_vector.h"

namespace fogbank::derivatives {

/// Signed form factor, in [-1/2, 1/2], of the segment from r1 to r2 = r1 + edge, both relative to the point;
/// positive if counter-clockwise seen from it. `edge` is the difference of the ends in the world, which keeps
/// far segments accurate. Derivatives are with respect to the point; the Hessian has no trace. Finite for all
/// finite input; an end closer than smallest_distance() leaves the segment without derivatives.
template <typename Real>
Jet<Real, 2> segment_form_factor_jet(const glm::vec<2, Real>& r1, const glm::vec<2, Real>& r2,
                                     const glm::vec<2, Real>& edge) {
  using Vector = glm::vec<2, Real>;
  const ScaledVector<Real, 2> a(r1);
  const ScaledVector<Real, 2> b(r2);
  const Real inverse_norms = a.inverse_norm * b.inverse_norm;
  const bool is_first_nearer = a.inverse_length() >= b.inverse_length();
  // r1 x r2 = r1 x edge = r2 x edge, from the nearer end.
  const Real sine = inverse_norms *
                    (is_first_nearer ? cross(a.mantissa, edge * b.scale) : cross(b.mantissa, edge * a.scale));
  const Real cosine = inverse_norms * glm::dot(a.mantissa, b.mantissa);
  // Vectors as complex numbers: 1/z1, 1/z2, Q = E / (z1 z2) and P = Q (1/z1 + 1/z2).
  const auto product = [](const Vector& p, const Vector& q) {
    return Vector(difference_of_products(p.x, q.x, p.y, q.y), p.x * q.y + p.y * q.x);
  };
  const auto inverse = [](const ScaledVector<Real, 2>& z) {
    return Vector(z.mantissa.x, -z.mantissa.y) * (z.inverse_norm * z.inverse_length());
  };
  const Vector inverse_a = inverse(a);
  const Vector inverse_b = inverse(b);
  // Over the longer first: the quotient is at most 2, however far apart the ends are.
  const Vector q = is_first_nearer ? product(product(edge, inverse_b), inverse_a)
                                   : product(product(edge, inverse_a), inverse_b);
  const Vector p = product(q, inverse_a + inverse_b);
  constexpr Real inverse_2pi = std::numbers::inv_pi_v<Real> / 2;
  return {std::atan2(sine, cosine) * inverse_2pi,
          Vector(q.y, q.x) * inverse_2pi,
          {{p.y * inverse_2pi, p.x * inverse_2pi, -p.y * inverse_2pi}}};
}

}  // namespace fogbank::derivatives
