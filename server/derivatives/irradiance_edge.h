// Cosine-weighted form factor of a polygon at a surface point, edge by edge (Lambert 1760; Arvo 1994, "The
// Irradiance Jacobian for Partially Occluded Polyhedral Sources", eq. 5), with derivatives with respect to
// the point: what irradiance records are assembled from.
#pragma once

#include <cmath>
#include <numbers>

#include "derivatives/transmittance_jet.h"

namespace fogbank::derivatives {

/// phi(C) = arccos(C) / sqrt(1 - C^2), the angle over its sine, with two derivatives.
template <typename Real>
struct AngleOverSine {
  Real value;
  Real first;
  Real second;

  explicit AngleOverSine(Real cosine) {
    const Real z = 1 - cosine;
    if (z < Real(series_limit)) {
      // Taylor series at C = 1, where the closed forms of the derivatives cancel: coefficients k! / (2k +
      // 1)!!.
      value = 1 + z * (Real(1) / 3 + z * (Real(2) / 15 + z * (Real(2) / 35 + z * Real(8) / 315)));
      first = -(Real(1) / 3 +
                z * (Real(4) / 15 + z * (Real(6) / 35 + z * (Real(32) / 315 + z * Real(40) / 693))));
      second = Real(4) / 15 +
               z * (Real(12) / 35 + z * (Real(32) / 105 + z * (Real(160) / 693 + z * Real(480) / 3003)));
      return;
    }
    // Opposite ends: the edge passes through the point, where no derivative exists.
    const Real sine2 = std::max(z * (1 + cosine), std::numeric_limits<Real>::epsilon());
    const Real sine = std::sqrt(sine2);
    value = std::atan2(sine, cosine) / sine;
    // From (1 - C^2) phi' = C phi - 1, and its derivative.
    first = (cosine * value - 1) / sine2;
    second = (value + 3 * cosine * first) / sine2;
  }

 private:
  /// The series' first neglected terms are below 3e-4 z^5 relative here; the closed form of the second
  /// derivative loses a factor z^2 / 2 of the digits.
  static constexpr double series_limit = sizeof(Real) == sizeof(double) ? 2e-3 : 3e-2;
};

/// Term of the directed edge a -> b: theta (n . a x b) / (|a x b| 2 pi), theta the angle at the point. Summed
/// around a polygon that lies above the horizon of `normal`, counter-clockwise seen from the point, it is the
/// polygon's cosine-weighted form factor: irradiance over (pi times the polygon's radiance), 1 for the whole
/// hemisphere. a, b: relative to the point; `normal`: unit, constant as the point moves. The opposite edge
/// has the negative term.
template <typename Real>
Jet<Real, 3> irradiance_edge_term(const glm::vec<3, Real>& a, const glm::vec<3, Real>& b,
                                  const glm::vec<3, Real>& normal) {
  using JetR = Jet<Real, 3>;
  const glm::vec<3, Real> edge = b - a;
  // n . (a x b) is linear in the point: its gradient n x (b - a) is constant.
  const JetR area = JetR::linear(glm::dot(normal, cross(a, edge)), cross(normal, edge));
  const Real dot = glm::dot(a, b);
  const JetR product{dot, -(a + b), Symmetric<Real, 3>::identity(2)};
  const JetR length_a = distance_jet<Real, 3>(a);
  const JetR length_b = distance_jet<Real, 3>(b);
  const JetR lengths = length_a * length_b;
  if (!(lengths.value > 0)) return {};
  const Real inverse = 1 / lengths.value;
  const JetR inverse_lengths = chain(lengths, inverse, -inverse * inverse, 2 * inverse * inverse * inverse);
  const JetR cosine = product * inverse_lengths;
  const AngleOverSine<Real> phi(std::clamp(cosine.value, Real(-1), Real(1)));
  return area * inverse_lengths * chain(cosine, phi.value, phi.first, phi.second) *
         (std::numbers::inv_pi_v<Real> / 2);
}

/// Cosine-weighted form factor of a triangle above the horizon: the sum around it, signed by its winding.
template <typename Real>
Jet<Real, 3> irradiance_form_factor(const glm::vec<3, Real>& a, const glm::vec<3, Real>& b,
                                    const glm::vec<3, Real>& c, const glm::vec<3, Real>& normal) {
  return irradiance_edge_term(a, b, normal) + irradiance_edge_term(b, c, normal) +
         irradiance_edge_term(c, a, normal);
}

}  // namespace fogbank::derivatives
