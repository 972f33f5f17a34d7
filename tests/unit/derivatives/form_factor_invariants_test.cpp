// Invariants I1 to I11 of method.md section 12 over random configurations, in float and double. Errors are
// relative to the size of the terms that are added, as no sum can be more accurate than they are.
#include <gtest/gtest.h>

#include "derivatives/closed_surroundings.h"
#include "derivatives/segment_form_factor.h"
#include "derivatives/triangle_form_factor.h"

namespace fogbank::derivatives {
namespace {

using test::closed_surroundings;
using test::Surroundings;
using test::uniform;
using test::uniform_direction;

constexpr uint32_t configurations = 10000;

template <typename Real>
class FormFactorInvariants : public testing::Test {
 public:
  static constexpr Real epsilon = std::numeric_limits<Real>::epsilon();
};
using Reals = testing::Types<float, double>;
TYPED_TEST_SUITE(FormFactorInvariants, Reals);

/// Vertices in random directions at distances over four decades.
template <typename Real>
RelativeTriangle<Real> random_triangle(RandomStream& random) {
  std::array<glm::vec<3, Real>, 3> r;
  for (auto& vertex : r)
    vertex = glm::vec<3, Real>(uniform_direction(random) * std::pow(10, uniform(random, -2, 2)));
  return RelativeTriangle<Real>::from_relative(r[0], r[1], r[2]);
}

/// A triangle whose corners are small integers, so that sums and halves of them are exact.
template <typename Real>
std::array<glm::vec<3, Real>, 4> random_integer_points(RandomStream& random) {
  std::array<glm::vec<3, Real>, 4> points;
  for (auto& point : points)
    for (int axis = 0; axis < 3; ++axis) point[axis] = static_cast<Real>(random.next_uint() % 2048) - 1024;
  return points;
}

/// Sizes of what is added up in the edge form: 1 for the value, the edges' gradients and Hessians.
template <typename Real>
std::array<Real, 3> magnitude(const RelativeTriangle<Real>& triangle) {
  std::array<Real, 3> result{1, 0, 0};
  for (size_t i = 0; i < 3; ++i) {
    const Jet<Real, 3> term =
        edge_term(ScaledVector<Real, 3>(triangle.vertices[i]),
                  ScaledVector<Real, 3>(triangle.vertices[(i + 1) % 3]), triangle.edges[i]);
    result[1] += glm::length(term.gradient);
    result[2] += term.hessian.norm();
  }
  return result;
}

template <typename Real>
void expect_near(const Jet<Real, 3>& found, const Jet<Real, 3>& expected,
                 const std::array<Real, 3>& magnitude, Real tolerance) {
  ASSERT_LE(std::abs(found.value - expected.value), tolerance * magnitude[0]);
  ASSERT_LE(glm::length(found.gradient - expected.gradient), tolerance * magnitude[1]);
  ASSERT_LE((found.hessian - expected.hessian).norm(), tolerance * magnitude[2]);
}

TYPED_TEST(FormFactorInvariants, I1I2ClosedSurroundingsSumToOneWithoutDerivatives) {
  using Real = TypeParam;
  for (uint32_t i = 0; i < configurations; ++i) {
    RandomStream random(1, i, 0, 0);
    // Two in five of these have inverted triangles.
    const Surroundings surroundings = closed_surroundings(random, static_cast<int>(i % 2), 0.6, 1e-2, 1e2);
    Jet<Real, 3> sum;
    std::array<Real, 3> sizes{};
    for (const auto& [a, b, c] : surroundings.triangles) {
      const Jet<Real, 3> term = triangle_form_factor_jet(RelativeTriangle<Real>::from_relative(
          glm::vec<3, Real>(surroundings.position(a)), glm::vec<3, Real>(surroundings.position(b)),
          glm::vec<3, Real>(surroundings.position(c))));
      sum += term;
      sizes[0] += std::abs(term.value);
      sizes[1] += glm::length(term.gradient);
      sizes[2] += term.hessian.norm();
    }
    // 1e-13 in double, and the same number of roundings in float.
    expect_near<Real>(sum, Jet<Real, 3>::constant(1), sizes, 450 * this->epsilon);
  }
}

TYPED_TEST(FormFactorInvariants, I3HessianHasNoTrace) {
  using Real = TypeParam;
  // Method.md: 1e-11, and 3e-4 measured in float.
  const Real tolerance = sizeof(Real) == 4 ? Real(3e-4) : Real(1e-11);
  for (uint32_t i = 0; i < configurations; ++i) {
    RandomStream random(3, i, 0, 0);
    const RelativeTriangle<Real> triangle = random_triangle<Real>(random);
    const Jet<Real, 3> jet = triangle_form_factor_jet(triangle);
    ASSERT_LE(std::abs(jet.hessian.trace()), tolerance * magnitude(triangle)[2]);
    const glm::vec<2, Real> a(triangle.vertices[0]);
    const glm::vec<2, Real> b(triangle.vertices[1]);
    ASSERT_EQ((segment_form_factor_jet<Real>(a, b, b - a).hessian.trace()), 0);
  }
}

TYPED_TEST(FormFactorInvariants, I4ScaleByPowersOfTwoIsExact) {
  using Real = TypeParam;
  for (uint32_t i = 0; i < configurations; ++i) {
    RandomStream random(4, i, 0, 0);
    const RelativeTriangle<Real> triangle = random_triangle<Real>(random);
    // As far as the Hessian is a normal number.
    const int exponent = static_cast<int>(random.next_uint() % 60) - 30;
    RelativeTriangle<Real> scaled = triangle;
    for (auto& vertex : scaled.vertices) vertex *= std::ldexp(Real(1), exponent);
    for (auto& edge : scaled.edges) edge *= std::ldexp(Real(1), exponent);
    const Jet<Real, 3> jet = triangle_form_factor_jet(triangle);
    const Jet<Real, 3> scaled_jet = triangle_form_factor_jet(scaled);
    ASSERT_EQ(scaled_jet.value, jet.value);
    ASSERT_EQ(scaled_jet.gradient * std::ldexp(Real(1), exponent), jet.gradient);
    ASSERT_EQ((scaled_jet.hessian * std::ldexp(Real(1), 2 * exponent)).entries, jet.hessian.entries);
  }
}

TYPED_TEST(FormFactorInvariants, I5TranslationAndRotation) {
  using Real = TypeParam;
  using Vector = glm::vec<3, Real>;
  for (uint32_t i = 0; i < configurations; ++i) {
    RandomStream random(5, i, 0, 0);
    const auto [x, v1, v2, v3] = random_integer_points<Real>(random);
    const Vector shift = random_integer_points<Real>(random)[0];
    const auto triangle = RelativeTriangle<Real>::from_world(x, v1, v2, v3);
    const auto moved = RelativeTriangle<Real>::from_world(x + shift, v1 + shift, v2 + shift, v3 + shift);
    ASSERT_EQ(moved.vertices, triangle.vertices);
    ASSERT_EQ(moved.edges, triangle.edges);

    const RelativeTriangle<Real> any = random_triangle<Real>(random);
    const glm::dmat3 turn(
        glm::rotate(glm::dmat4(1), uniform(random, 0, 2 * M_PI), uniform_direction(random)));
    const glm::mat<3, 3, Real> turn_real(turn);
    RelativeTriangle<Real> turned;
    for (size_t k = 0; k < 3; ++k) turned.vertices[k] = Vector(turn * Vec3d(any.vertices[k]));
    for (size_t k = 0; k < 3; ++k) turned.edges[k] = Vector(turn * Vec3d(any.edges[k]));
    const Jet<Real, 3> jet = triangle_form_factor_jet(any);
    const Jet<Real, 3> turned_jet = triangle_form_factor_jet(turned);
    Jet<Real, 3> expected{jet.value, turn_real * jet.gradient, {}};
    glm::mat<3, 3, Real> full;
    for (int row = 0; row < 3; ++row)
      for (int column = 0; column < 3; ++column) full[column][row] = jet.hessian(row, column);
    full = turn_real * full * glm::transpose(turn_real);
    for (int row = 0; row < 3; ++row)
      for (int column = row; column < 3; ++column) expected.hessian(row, column) = full[column][row];
    // Rounding of the turned vertices, enlarged close to edges (the closest of 30 000 is 0.01 radian away).
    expect_near<Real>(turned_jet, expected, magnitude(any), 450 * this->epsilon);
  }
}

TYPED_TEST(FormFactorInvariants, I6OrderOfVertices) {
  using Real = TypeParam;
  for (uint32_t i = 0; i < configurations; ++i) {
    RandomStream random(6, i, 0, 0);
    const RelativeTriangle<Real> triangle = random_triangle<Real>(random);
    const auto& [r1, r2, r3] = triangle.vertices;
    const Jet<Real, 3> jet = triangle_form_factor_jet(triangle);
    const Jet<Real, 3> swapped = triangle_form_factor_jet(RelativeTriangle<Real>::from_relative(r2, r1, r3));
    const Jet<Real, 3> cycled = triangle_form_factor_jet(RelativeTriangle<Real>::from_relative(r2, r3, r1));
    // Only the order in which the three edges and vertices are added differs.
    ASSERT_EQ(swapped.value, -jet.value);
    ASSERT_EQ(cycled.value, jet.value);
    expect_near<Real>(swapped, jet * Real(-1), magnitude(triangle), 16 * this->epsilon);
    expect_near<Real>(cycled, jet, magnitude(triangle), 16 * this->epsilon);
  }
}

TYPED_TEST(FormFactorInvariants, I7PartsAddUp) {
  using Real = TypeParam;
  for (uint32_t i = 0; i < configurations; ++i) {
    RandomStream random(7, i, 0, 0);
    const auto [x, v1, v2, v3] = random_integer_points<Real>(random);
    const glm::vec<3, Real> middle = (v1 + v2) / Real(2);
    const auto whole = RelativeTriangle<Real>::from_world(x, v1, v2, v3);
    const auto left = RelativeTriangle<Real>::from_world(x, v1, middle, v3);
    const auto right = RelativeTriangle<Real>::from_world(x, middle, v2, v3);
    const auto left_size = magnitude(left);
    const auto right_size = magnitude(right);
    const std::array<Real, 3> size{1, left_size[1] + right_size[1], left_size[2] + right_size[2]};
    expect_near<Real>(triangle_form_factor_jet(left) + triangle_form_factor_jet(right),
                      triangle_form_factor_jet(whole), size, 450 * this->epsilon);
  }
}

TYPED_TEST(FormFactorInvariants, I8EdgesOfAClosedTriangleHaveASymmetricHessian) {
  using Real = TypeParam;
  using Vector = glm::vec<3, Real>;
  // edge_term() keeps the symmetric part of h = k [e]_x + c (grad k)^T (method.md section 4.3). The rest, the
  // cross product with k e + (grad k x c)/2, must vanish in the sum.
  for (uint32_t i = 0; i < configurations; ++i) {
    RandomStream random(8, i, 0, 0);
    const auto [r1, r2, r3] = random_triangle<Real>(random).vertices;
    Vector sum(0);
    Real size = 0;
    for (const auto& [a, b] : {std::pair(r1, r2), std::pair(r2, r3), std::pair(r3, r1)}) {
      const Real la = glm::length(a);
      const Real lb = glm::length(b);
      const Real dot = glm::dot(a, b);
      const Vector c = glm::cross(a, b);
      const Real s = dot < 0 ? glm::dot(c, c) / (la * lb - dot) : la * lb + dot;
      const Real inverse_sum = 1 / la + 1 / lb;
      const Vector gradient_k = (a / (la * la * la) + b / (lb * lb * lb)) / s +
                                inverse_sum * (la + lb) * (a / la + b / lb) / (s * s);
      const Vector straight = (b - a) * (inverse_sum / s);
      const Vector turned = glm::cross(gradient_k, c) / Real(2);
      sum += straight + turned;
      size += glm::length(straight) + glm::length(turned);
    }
    // Method.md: 1e-11. Lengths differ by up to 1e4.
    ASSERT_LE(glm::length(sum), (sizeof(Real) == 4 ? Real(2e-3) : Real(1e-11)) * size);
  }
}

TYPED_TEST(FormFactorInvariants, I10OctantIsAnEighth) {
  using Real = TypeParam;
  using Vector = glm::vec<3, Real>;
  for (uint32_t i = 0; i < configurations; ++i) {
    RandomStream random(10, i, 0, 0);
    std::array<Real, 3> l;
    for (Real& length : l) length = static_cast<Real>(std::pow(10, uniform(random, -3, 3)));
    const Real value = triangle_form_factor(
        RelativeTriangle<Real>::from_relative(Vector(l[0], 0, 0), Vector(0, l[1], 0), Vector(0, 0, l[2])));
    ASSERT_NEAR(value, 0.125, 0.5 * this->epsilon);
  }
}

TYPED_TEST(FormFactorInvariants, I11SmallAndFarIsProjectedAreaOverDistanceSquared) {
  using Real = TypeParam;
  using Vector = glm::vec<3, Real>;
  for (uint32_t i = 0; i < configurations; ++i) {
    RandomStream random(11, i, 0, 0);
    const double ratio = std::pow(10, uniform(random, -9, -2));
    const Vec3d far = uniform_direction(random);
    std::array<Vec3d, 3> offsets;
    for (Vec3d& offset : offsets) offset = ratio * uniform(random, 0.2, 1) * uniform_direction(random);
    const Vec3d center = (offsets[0] + offsets[1] + offsets[2]) / 3.0;
    for (Vec3d& offset : offsets) offset -= center;
    const Vec3d normal = glm::cross(offsets[1] - offsets[0], offsets[2] - offsets[0]) / 2.0;
    const RelativeTriangle<Real> triangle{
        {Vector(far + offsets[0]), Vector(far + offsets[1]), Vector(far + offsets[2])},
        {Vector(offsets[1] - offsets[0]), Vector(offsets[2] - offsets[1]), Vector(offsets[0] - offsets[2])}};
    const double expected = glm::dot(normal, far) / (4 * M_PI);
    // Second order in the size; rounding of the distance and the direction.
    const double tolerance = 10 * ratio * ratio + 16 * static_cast<double>(this->epsilon);
    ASSERT_NEAR(static_cast<double>(triangle_form_factor(triangle)), expected,
                tolerance * glm::length(offsets[0]) * glm::length(offsets[1] - offsets[2]));
  }
}

TYPED_TEST(FormFactorInvariants, FiniteWhateverTheInput) {
  using Real = TypeParam;
  using Vector = glm::vec<3, Real>;
  constexpr int most = std::numeric_limits<Real>::max_exponent - 4;
  for (uint32_t i = 0; i < configurations; ++i) {
    RandomStream random(12, i, 0, 0);
    // Lengths over all exponents that a Real has; corners that coincide, lie on a line with the point or are
    // the point.
    std::array<Vector, 3> r;
    for (Vector& vertex : r) {
      const int exponent = static_cast<int>(uniform(random, -most, most));
      vertex = Vector(uniform_direction(random)) * std::ldexp(Real(1), exponent);
    }
    const uint32_t kind = random.next_uint() % 8;
    if (kind == 0) r[1] = r[0];
    if (kind == 1) r[2] = r[1] = r[0];
    if (kind == 2) r[0] = Vector(0);
    if (kind == 3) r[1] = -r[0];
    if (kind == 4) r[1] = r[0] * Real(2);
    if (kind == 5) r[1] = -r[0] * (1 + this->epsilon);
    const auto triangle = RelativeTriangle<Real>::from_relative(r[0], r[1], r[2]);
    for (const Jet<Real, 3>& jet : {triangle_form_factor_jet(triangle),
                                    triangle_form_factor_edges(triangle, scaled_vertices(triangle))}) {
      ASSERT_LE(std::abs(jet.value), Real(0.5));
      for (int axis = 0; axis < 3; ++axis) ASSERT_TRUE(std::isfinite(jet.gradient[axis]));
      for (const Real entry : jet.hessian.entries) ASSERT_TRUE(std::isfinite(entry));
    }
    const Jet<Real, 2> segment =
        segment_form_factor_jet<Real>({r[0].x, r[0].y}, {r[1].x, r[1].y}, {r[1].x - r[0].x, r[1].y - r[0].y});
    ASSERT_LE(std::abs(segment.value), Real(0.5));
    for (int axis = 0; axis < 2; ++axis) ASSERT_TRUE(std::isfinite(segment.gradient[axis]));
    for (const Real entry : segment.hessian.entries) ASSERT_TRUE(std::isfinite(entry));
  }
}

}  // namespace
}  // namespace fogbank::derivatives
