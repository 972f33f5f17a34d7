// Transmittance of a homogeneous medium between a point and a fixed vertex, and its integral along that line,
// with derivatives with respect to the point (method.md sections 5 and 8.3), in two and three dimensions.
#pragma once

#include "derivatives/jet.h"
#include "derivatives/scaled_vector.h"

namespace fogbank::derivatives {

/// d = |r| with gradient -u and Hessian (I - u u^T)/d; r = vertex - point. Without derivatives below
/// smallest_distance().
template <typename Real, int Dim>
Jet<Real, Dim> distance_jet(const glm::vec<Dim, Real>& r) {
  const ScaledVector<Real, Dim> scaled(r);
  if (scaled.scale == 0) return {};
  const glm::vec<Dim, Real> u = scaled.unit();
  return {1 / scaled.inverse_length(), -u,
          (Symmetric<Real, Dim>::identity() - Symmetric<Real, Dim>::outer(u)) * scaled.inverse_length()};
}

/// exp(-sigma_t distance); exactly 0 where a normal Real can't hold it. sigma_t >= 0, 1/length.
template <typename Real>
Real transmittance(Real sigma_t, Real distance) {
  const Real value = std::exp(-sigma_t * distance);
  return value < std::numeric_limits<Real>::min() ? Real(0) : value;
}

/// T = exp(-sigma_t d) of a distance jet (any smooth distance will do: exit points, virtual images).
template <typename Real, int Dim>
Jet<Real, Dim> transmittance_jet(Real sigma_t, const Jet<Real, Dim>& distance) {
  const Real value = transmittance(sigma_t, distance.value);
  const Real slope = -sigma_t * value;
  const Real curvature = -sigma_t * slope;
  // sigma_t^2 overflows: nothing gets through, or the distance is (nearly) 0 and has no derivatives.
  if (value == 0 || !std::isfinite(curvature)) return Jet<Real, Dim>::constant(value);
  return chain(distance, value, slope, curvature);
}

/// E(d) = integral of T from 0 to d = (1 - exp(-sigma_t d)) / sigma_t, which tends to d as sigma_t -> 0.
template <typename Real>
Real transmittance_integral(Real sigma_t, Real distance) {
  const Real depth = sigma_t * distance;
  if (depth == 0) return distance;
  return depth < 1 ? distance * (-std::expm1(-depth) / depth) : -std::expm1(-depth) / sigma_t;
}

template <typename Real, int Dim>
Jet<Real, Dim> transmittance_integral_jet(Real sigma_t, const Jet<Real, Dim>& distance) {
  const Real value = transmittance(sigma_t, distance.value);
  const Real integral = transmittance_integral(sigma_t, distance.value);
  if (value == 0) return Jet<Real, Dim>::constant(integral);
  return chain(distance, integral, value, -sigma_t * value);
}

}  // namespace fogbank::derivatives
