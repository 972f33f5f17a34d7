// Form factor of a triangle at a point: signed solid angle / 4 pi, with gradient and Hessian with respect to
// the point. Closed forms of method.md section 4 (value: Van Oosterom and Strackee 1983).
#pragma once

#include <array>
#include <numbers>

#include "derivatives/jet.h"
#include "derivatives/scaled_vector.h"

namespace fogbank::derivatives {

/// A triangle as seen from a point x: positive form factor if counter-clockwise seen from x, i.e.
/// r1 . (r2 x r3) > 0. Edges are kept besides the vertices: taken from the vertices in the world they lose
/// nothing to cancellation (method.md section 4.2).
template <typename Real>
struct RelativeTriangle {
  using Vector = glm::vec<3, Real>;

  std::array<Vector, 3> vertices;  ///< r_i = v_i - x
  std::array<Vector, 3> edges;     ///< v_2 - v_1, v_3 - v_2, v_1 - v_3

  static RelativeTriangle from_relative(const Vector& r1, const Vector& r2, const Vector& r3) {
    return {{r1, r2, r3}, {r2 - r1, r3 - r2, r1 - r3}};
  }
  static RelativeTriangle from_world(const Vector& x, const Vector& v1, const Vector& v2, const Vector& v3) {
    return {{v1 - x, v2 - x, v3 - x}, {v2 - v1, v3 - v2, v1 - v3}};
  }
};

template <typename Real>
using ScaledVertices = std::array<ScaledVector<Real, 3>, 3>;

template <typename Real>
ScaledVertices<Real> scaled_vertices(const RelativeTriangle<Real>& triangle) {
  const auto& [r1, r2, r3] = triangle.vertices;
  return {ScaledVector<Real, 3>(r1), ScaledVector<Real, 3>(r2), ScaledVector<Real, 3>(r3)};
}

/// Arctangent: differentiates the formula of the value; exact for small and far triangles, loses digits close
/// to edges. Edge: sum of one term an edge; the reverse.
enum class TriangleForm : uint8_t { arctangent, edge };

/// What two vertices contribute, with every length divided out: c = r_a x r_b / (l_a l_b) and
/// s = 1 + u_a . u_b, the latter by the product identity of method.md section 4.1 beyond a right angle.
template <typename Real>
struct EdgeAngle {
  glm::vec<3, Real> c;
  Real cosine;
  Real s;

  /// `edge` = b - a. c comes from the nearer end, where the difference is not swamped by the far one.
  EdgeAngle(const ScaledVector<Real, 3>& a, const ScaledVector<Real, 3>& b, const glm::vec<3, Real>& edge)
      : cosine(glm::dot(a.mantissa, b.mantissa) * (a.inverse_norm * b.inverse_norm)) {
    const Real product = a.inverse_norm * b.inverse_norm;
    c = a.inverse_length() >= b.inverse_length() ? cross(a.mantissa, edge * b.scale) * product
                                                 : cross(b.mantissa, edge * a.scale) * product;
    s = cosine >= 0 ? 1 + cosine : glm::dot(c, c) / (1 - cosine);
  }
};

/// Term of the directed edge a -> b = a + edge in the edge form (method.md section 4.3), divided by 4 pi:
/// gradient, and the symmetric part of the Hessian (the rest cancels in any closed sum). An edge has no share
/// of the value, which stays 0. The opposite edge has exactly the negative term, so an edge between two
/// triangles needs one evaluation, times the difference of their weights. Zero if x is closer to the edge
/// than `smallest_distance` or 1e-18 (float), 1e-153 (double) of its distance to the ends: there no gradient
/// exists.
template <typename Real>
Jet<Real, 3> edge_term(const ScaledVector<Real, 3>& a, const ScaledVector<Real, 3>& b,
                       const glm::vec<3, Real>& edge) {
  using Vector = glm::vec<3, Real>;
  const EdgeAngle<Real> angle(a, b, edge);
  const Real inverse_a = a.inverse_length();
  const Real inverse_b = b.inverse_length();
  const Real inverse_sum = inverse_a + inverse_b;
  const Real limit = smallest_distance<Real>() * inverse_sum;
  if (a.scale == 0 || b.scale == 0 || angle.s < std::numeric_limits<Real>::min() ||
      2 * angle.s < limit * limit)
    return {};
  const Vector u_a = a.unit();
  const Vector u_b = b.unit();
  // Nearly opposite directions cancel in u_a + u_b; (u_a x u_b) x (u_a - u_b) = (1 - cosine)(u_a + u_b).
  const Vector u_sum = angle.cosine >= 0 ? u_a + u_b : cross(angle.c, u_a - u_b) / (1 - angle.cosine);
  constexpr Real inverse_4pi = std::numbers::inv_pi_v<Real> / 4;
  // c k l_a l_b and grad k / (k l_a l_b) of section 4.3; 1/s is shared out so that neither factor overflows.
  const Vector left = angle.c * (inverse_4pi / angle.s);
  const Vector right = (u_a * inverse_a) * inverse_a + (u_b * inverse_b) * inverse_b +
                       (u_sum * (inverse_sum / angle.s)) * inverse_sum;
  return {0, left * inverse_sum, Symmetric<Real, 3>::outer_sum(left, right) * Real(0.5)};
}

/// (v_2 - v_1) x (v_3 - v_1) times both scales, those of the two farther vertices. Any two edges give it; the
/// two shortest lose least to the rounding of the edges when the triangle is a needle.
template <typename Real>
glm::vec<3, Real> triangle_normal(const RelativeTriangle<Real>& triangle, Real scale_1, Real scale_2) {
  const auto [far_scale, near_scale] = std::minmax(scale_1, scale_2);
  std::array<Real, 3> squares;
  for (size_t i = 0; i < 3; ++i) {
    const glm::vec<3, Real> edge = triangle.edges[i] * far_scale;
    squares[i] = glm::dot(edge, edge);
  }
  const auto longest =
      static_cast<size_t>(std::max_element(squares.begin(), squares.end()) - squares.begin());
  const size_t next = (longest + 1) % 3;
  const size_t last = (longest + 2) % 3;
  // The shorter edge is as long as its scale says at most, hence no overflow.
  const bool is_next_shorter = squares[next] < squares[last];
  return cross(triangle.edges[next] * (is_next_shorter ? near_scale : far_scale),
               triangle.edges[last] * (is_next_shorter ? far_scale : near_scale));
}

/// Form factor by its value alone: accurate on edges, on the triangle's plane and for any ratio of distances
/// (method.md section 4.4). +-1/2 on the triangle itself, 0 elsewhere on its plane.
template <typename Real>
Real triangle_form_factor(const RelativeTriangle<Real>& triangle, const ScaledVertices<Real>& r) {
  const std::array<EdgeAngle<Real>, 3> angles{EdgeAngle<Real>(r[0], r[1], triangle.edges[0]),
                                              EdgeAngle<Real>(r[1], r[2], triangle.edges[1]),
                                              EdgeAngle<Real>(r[2], r[0], triangle.edges[2])};
  size_t near = 0;
  size_t widest = 0;    // the edge with the largest s; the pivot is the vertex opposite
  size_t straight = 0;  // the edge with the smallest |c|: the shortest as seen, or nearly through the point
  for (size_t i = 1; i < 3; ++i) {
    if (r[i].inverse_length() > r[near].inverse_length()) near = i;
    if (angles[i].s > angles[widest].s) widest = i;
    if (glm::dot(angles[i].c, angles[i].c) < glm::dot(angles[straight].c, angles[straight].c)) straight = i;
  }
  // A and B of section 4.1 over l1 l2 l3. A = r . normal from the nearest vertex, or c . u of an edge and the
  // vertex opposite: whichever product is of smaller vectors and thus has the smaller error, the latter close
  // to edges.
  const ScaledVector<Real, 3>& second = r[(near + 1) % 3];
  const ScaledVector<Real, 3>& third = r[(near + 2) % 3];
  const Real inverse_norms = second.inverse_norm * third.inverse_norm;
  const glm::vec<3, Real> normal = triangle_normal(triangle, second.scale, third.scale) * inverse_norms;
  const glm::vec<3, Real>& c = angles[straight].c;
  const Real a = glm::dot(c, c) < glm::dot(normal, normal) ? glm::dot(c, r[(straight + 2) % 3].unit())
                                                           : glm::dot(r[near].unit(), normal);
  const EdgeAngle<Real>& before = angles[(widest + 1) % 3];
  const EdgeAngle<Real>& after = angles[(widest + 2) % 3];
  // c of `before` points toward the pivot and that of `after` away from it, hence the minus.
  const Real b = before.s * after.s - glm::dot(before.c, after.c);
  return std::atan2(a, b) * (std::numbers::inv_pi_v<Real> / 2);
}

/// The form whose derivatives are the more accurate. In the edge form the terms of small or thin triangles
/// cancel (method.md section 4.3, whose rule of 0.05 covers the small ones); the arctangent form loses digits
/// only close to edges, in proportion to 1 + cosine of the angle between two vertices. So: arctangent unless
/// two vertices are more than 120 degrees apart, or distances differ so much that products of six of them
/// need not fit a Real.
template <typename Real>
TriangleForm select_triangle_form(const ScaledVertices<Real>& r) {
  constexpr Real largest_ratio = 1000;
  for (size_t i = 0; i < 3; ++i) {
    const ScaledVector<Real, 3>& a = r[i];
    const ScaledVector<Real, 3>& b = r[(i + 1) % 3];
    const Real cosine = glm::dot(a.mantissa, b.mantissa) * a.inverse_norm * b.inverse_norm;
    const Real least = largest_ratio * std::min(a.inverse_length(), b.inverse_length());
    // Also if a distance is 0 for want of digits.
    if (!(cosine > Real(-0.5) && std::max(a.inverse_length(), b.inverse_length()) < least))
      return TriangleForm::edge;
  }
  return TriangleForm::arctangent;
}

/// method.md section 4.1. For triangles that select_triangle_form() gives to it; others may overflow.
template <typename Real>
Jet<Real, 3> triangle_form_factor_arctangent(const RelativeTriangle<Real>& triangle,
                                             const ScaledVertices<Real>& scaled) {
  using Vector = glm::vec<3, Real>;
  using Matrix = Symmetric<Real, 3>;
  const Real scale = scaled[0].scale;
  std::array<Vector, 3> r;
  std::array<Vector, 3> u;
  std::array<Real, 3> length;
  for (size_t i = 0; i < 3; ++i) {
    r[i] = triangle.vertices[i] * scale;
    length[i] = std::sqrt(glm::dot(r[i], r[i]));
    u[i] = r[i] / length[i];
  }
  const Vector normal = triangle_normal(triangle, scale, scale);
  const auto nearest = static_cast<size_t>(std::min_element(length.begin(), length.end()) - length.begin());
  const Real a = glm::dot(r[nearest], normal);
  Real b = length[0] * length[1] * length[2];
  Real d = 2;  // A^2 + B^2 = 2 s12 s23 s31
  Vector gradient_b(0);
  Matrix hessian_b;
  for (size_t i = 0; i < 3; ++i) {
    const size_t j = (i + 1) % 3;
    const size_t k = (i + 2) % 3;
    const Real dot = glm::dot(r[i], r[j]);
    const Real lengths = length[i] * length[j];
    const Vector sum = r[i] + r[j];
    b += dot * length[k];
    d *= lengths + dot;
    gradient_b -= (lengths + dot) * u[k] + length[k] * sum;
    // Hessians of (r_i . r_j) l_k and of l1 l2 l3; I - u u^T has the factor of both.
    const Real transverse = (dot + lengths) / length[k];
    hessian_b += Matrix::identity(2 * length[k] + transverse) - transverse * Matrix::outer(u[k]) +
                 Matrix::outer_sum(sum, u[k]) + length[k] * Matrix::outer_sum(u[i], u[j]);
  }
  const Real a_d = a / d;
  const Real b_d = b / d;
  constexpr Real inverse_2pi = std::numbers::inv_pi_v<Real> / 2;
  // gradient of A is -normal, its Hessian 0.
  const Vector gradient = -(b_d * normal + a_d * gradient_b);
  const Matrix hessian = -a_d * hessian_b -
                         (2 * a_d * b_d) * (Matrix::outer(normal) - Matrix::outer(gradient_b)) -
                         (a_d * a_d - b_d * b_d) * Matrix::outer_sum(normal, gradient_b);
  return {triangle_form_factor(triangle, scaled), gradient * (inverse_2pi * scale),
          hessian * (inverse_2pi * scale) * scale};
}

/// method.md section 4.3: the three edge terms, with the value by section 4.4.
template <typename Real>
Jet<Real, 3> triangle_form_factor_edges(const RelativeTriangle<Real>& triangle,
                                        const ScaledVertices<Real>& scaled) {
  Jet<Real, 3> jet = edge_term(scaled[0], scaled[1], triangle.edges[0]);
  jet += edge_term(scaled[1], scaled[2], triangle.edges[1]);
  jet += edge_term(scaled[2], scaled[0], triangle.edges[2]);
  jet.value = triangle_form_factor(triangle, scaled);
  return jet;
}

/// Signed form factor (solid angle / 4 pi, in [-1/2, 1/2]) with gradient (1/length) and Hessian (1/length^2)
/// with respect to the point, in the form that suits the triangle. Finite for all finite input of magnitudes
/// up to a tenth of the largest Real; on an edge, where derivatives are infinite, that edge counts as absent.
/// Degenerate triangles have form factor 0 and derivatives that are 0 up to rounding.
/// Errors stay at a few ulp, but for inputs that rounding blurs: within 1e-5 of an edge (of the triangle's
/// size), and for triangles whose corners lie within 1e-5 of a line, floats no longer hold two digits and
/// doubles are due. `make stability` measures it.
template <typename Real>
Jet<Real, 3> triangle_form_factor_jet(const RelativeTriangle<Real>& triangle) {
  const ScaledVertices<Real> scaled = scaled_vertices(triangle);
  return select_triangle_form(scaled) == TriangleForm::arctangent
             ? triangle_form_factor_arctangent(triangle, scaled)
             : triangle_form_factor_edges(triangle, scaled);
}

/// The value alone.
template <typename Real>
Real triangle_form_factor(const RelativeTriangle<Real>& triangle) {
  return triangle_form_factor(triangle, scaled_vertices(triangle));
}

}  // namespace fogbank::derivatives
