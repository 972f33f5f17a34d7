// Light from shells of the medium around a point: what one ray's samples add up to, and triangles of a shell
// that a surface cuts off (method.md section 8).
#pragma once

#include <algorithm>
#include <array>

#include "derivatives/transmittance_jet.h"
#include "derivatives/triangle_form_factor.h"

namespace fogbank::derivatives {

/// What a ray's samples contribute, apart from the grid's geometry (method.md section 8.4). A sample at
/// distance s has the weight w = integral over its stratum of sigma_s (q - q0) times transmittance; shells
/// being scaled copies of the unit sphere's, a triangle's form factor at s is F, its gradient grad F / s and
/// its Hessian H F / s^2.
template <typename Real>
struct ShellMoments {
  using Vector = glm::vec<3, Real>;
  using Matrix = Symmetric<Real, 3>;

  Vector slope{0};          ///< sum of w grad log T: times F in the gradient
  Real inverse = 0;         ///< sum of w / s: times grad F in the gradient
  Matrix curvature{};       ///< sum of w (Hessian of T) / T: times F in the Hessian
  Vector cross{0};          ///< sum of w grad log T / s: times grad F in the Hessian, symmetrised
  Real inverse_square = 0;  ///< sum of w / s^2: times H F + F (I - u u^T) in the Hessian

  /// Samples within one homogeneous medium around the point, along the unit vector `u`, by their sums of
  /// w s^-n. `gradient_*` serve the gradient, the others the Hessian: for samples close to the point the two
  /// rest on different parts of the source (NearField).
  void add_homogeneous(const Vector& u, Real sigma_t, Real gradient_0, Real gradient_1, Real hessian_0,
                       Real hessian_1, Real hessian_2) {
    slope += (sigma_t * gradient_0) * u;
    inverse += gradient_1;
    const Matrix along = Matrix::outer(u);
    curvature +=
        along * (sigma_t * (sigma_t * hessian_0 + hessian_1)) - Matrix::identity(sigma_t * hessian_1);
    cross += (sigma_t * hessian_1) * u;
    inverse_square += hessian_2;
  }
  /// One sample at `distance` behind any media: `transmittance` up to it over its value.
  void add_sample(Real weight, Real distance, const Jet<Real, 3>& transmittance) {
    slope += weight * transmittance.gradient;
    inverse += weight / distance;
    curvature += weight * transmittance.hessian;
    cross += (weight / distance) * transmittance.gradient;
    inverse_square += weight / distance / distance;
  }
  ShellMoments& operator+=(const ShellMoments& other) {
    slope += other.slope;
    inverse += other.inverse;
    curvature += other.curvature;
    cross += other.cross;
    inverse_square += other.inverse_square;
    return *this;
  }
};

/// Gradient and Hessian of what the samples along `u` send through the form factor `form` of the unit sphere
/// (value 0: values are means over rays). The last term of the Hessian is the path-length term of method.md
/// section 8.3: a shell of fixed thickness is crossed at an angle once the point has moved.
template <typename Real>
Jet<Real, 3> shell_jet(const Jet<Real, 3>& form, const glm::vec<3, Real>& u,
                       const ShellMoments<Real>& moments) {
  using Matrix = Symmetric<Real, 3>;
  return {0, form.value * moments.slope + moments.inverse * form.gradient,
          form.value * moments.curvature + Matrix::outer_sum(moments.cross, form.gradient) +
              moments.inverse_square * (form.hessian + (Matrix::identity() - Matrix::outer(u)) * form.value)};
}

/// The lit part of a shell's triangle whose rays end on different surfaces, some of them before the shell:
/// up to four corners, counter-clockwise as the triangle.
template <typename Real>
struct ShellPolygon {
  std::array<glm::vec<3, Real>, 4> corners;
  size_t size = 0;

  void add(const glm::vec<3, Real>& corner) { corners[size++] = corner; }
};

template <typename Real>
Jet<Real, 3> polygon_form_factor(const ShellPolygon<Real>& polygon) {
  Jet<Real, 3> sum;
  for (size_t i = 2; i < polygon.size; ++i)
    sum += triangle_form_factor_jet(RelativeTriangle<Real>::from_relative(
        polygon.corners[0], polygon.corners[i - 1], polygon.corners[i]));
  return sum;
}

/// `directions` and `ends` of the triangle's rays; `outline(i, j)` is the point, relative to the centre,
/// where the outline of what ends ray i lies on the way to ray j, which goes on behind it. Outlines are where
/// the shell's lit part begins, so that it moves as they do (method.md section 8.1); what is known least of
/// them is ray i's own end.
template <typename Real, typename Outline>
ShellPolygon<Real> lit_polygon(const std::array<glm::vec<3, Real>, 3>& directions,
                               const std::array<Real, 3>& ends, Real distance, const Outline& outline) {
  ShellPolygon<Real> polygon;
  for (size_t i = 0; i < 3; ++i) {
    const size_t j = (i + 1) % 3;
    const bool alive = ends[i] > distance;
    if (alive) polygon.add(directions[i] * distance);
    if (alive == (ends[j] > distance)) continue;
    polygon.add(alive ? outline(j, i) : outline(i, j));
  }
  return polygon;
}

/// Integral of s exp(-sigma_t s) from 0 to `distance`, over `distance`.
template <typename Real>
Real mean_transmitted_distance(Real sigma_t, Real distance) {
  const Real depth = sigma_t * distance;
  // The difference below cancels; the series is exact to rounding there.
  if (depth < Real(0.01))
    return distance * (Real(1) / 2 -
                       depth * (Real(1) / 3 - depth * (Real(1) / 8 - depth * (Real(1) / 30 - depth / 144))));
  const Real integral = transmittance_integral(sigma_t, distance);
  return (integral / distance - transmittance(sigma_t, distance)) / sigma_t;
}

/// What a medium of linear source, `value` at the point and `slope` its gradient there, sends along the line
/// to a vertex, all fixed in the world; per unit of sigma_s. Extends the closed form of method.md
/// section 8.3: value times the integral of transmittance, plus slope times that of transmittance times
/// distance.
template <typename Real>
Jet<Real, 3> linear_source_jet(Real sigma_t, const glm::vec<3, Real>& vertex, Real value,
                               const glm::vec<3, Real>& slope) {
  const Jet<Real, 3> distance = distance_jet(vertex);
  const Real d = distance.value;
  if (!(d > 0)) return {};
  const Jet<Real, 3> at_point = Jet<Real, 3>::linear(value, slope);
  const Jet<Real, 3> rise = Jet<Real, 3>::linear(glm::dot(slope, vertex), -slope);
  const Real through = transmittance(sigma_t, d);
  const Real mean = mean_transmitted_distance(sigma_t, d);
  const Real first = through - mean / d;
  const Real second = -sigma_t * through - (first - mean / d) / d;
  return at_point * transmittance_integral_jet(sigma_t, distance) +
         rise * chain(distance, mean, first, second);
}

}  // namespace fogbank::derivatives
