// Closed forms against the high-precision answers of tests/numerics/vectors. Double is held against those
// themselves; float against double on the same, rounded, input, so that what is measured is the formula and
// not the input's rounding.
#include <gtest/gtest.h>

#include <fstream>
#include <nlohmann/json.hpp>

#include "derivatives/segment_form_factor.h"
#include "derivatives/transmittance_jet.h"
#include "derivatives/triangle_form_factor.h"

namespace fogbank::derivatives {
namespace {

using nlohmann::json;

json cases(const std::string& name) {
  // Relative to the root of the repository, where CTest runs.
  std::ifstream file("tests/numerics/vectors/" + name + ".json");
  return json::parse(file).at("cases");
}

template <int Dim>
glm::vec<Dim, double> vector(const json& numbers) {
  glm::vec<Dim, double> result;
  for (int i = 0; i < Dim; ++i) result[i] = numbers.at(static_cast<size_t>(i)).get<double>();
  return result;
}

template <int Dim>
Jet<double, Dim> jet(const json& numbers) {
  Jet<double, Dim> result;
  result.value = numbers.at("value").get<double>();
  result.gradient = vector<Dim>(numbers.at("gradient"));
  for (size_t i = 0; i < result.hessian.entries.size(); ++i)
    result.hessian.entries[i] = numbers.at("hessian").at(i).get<double>();
  return result;
}

template <typename Real, int Dim>
Jet<double, Dim> widen(const Jet<Real, Dim>& narrow) {
  Jet<double, Dim> result{static_cast<double>(narrow.value), glm::vec<Dim, double>(narrow.gradient), {}};
  for (size_t i = 0; i < result.hessian.entries.size(); ++i)
    result.hessian.entries[i] = static_cast<double>(narrow.hessian.entries[i]);
  return result;
}

/// Errors relative to value, gradient and Hessian (0 where both are 0).
struct Errors {
  double value = 0;
  double gradient = 0;
  double hessian = 0;
};

double ratio(double error, double size) { return error == 0 ? 0 : error / size; }

template <int Dim>
Errors errors(const Jet<double, Dim>& found, const Jet<double, Dim>& truth) {
  // Norms would overflow at scales of 1e140.
  const auto largest = [](const auto& numbers, int count) {
    double result = 0;
    for (int i = 0; i < count; ++i) result = std::max(result, std::abs(numbers(i)));
    return result;
  };
  const auto gradient = [](const Jet<double, Dim>& of) { return [&of](int i) { return of.gradient[i]; }; };
  const auto hessian = [](const Jet<double, Dim>& of) {
    return [&of](int i) { return of.hessian.entries[static_cast<size_t>(i)]; };
  };
  const Jet<double, Dim> difference = found + truth * -1.0;
  constexpr int size = Symmetric<double, Dim>::size;
  return {ratio(std::abs(difference.value), std::abs(truth.value)),
          ratio(largest(gradient(difference), Dim), largest(gradient(truth), Dim)),
          ratio(largest(hessian(difference), size), largest(hessian(truth), size))};
}

/// Bounds in epsilons, at least twice what was found on x86-64.
struct Bounds {
  double value = 32;
  double gradient = 32;
  double hessian = 32;
};

Bounds triangle_bounds(const std::string& tag) {
  // Vertices differ by 1e-7 of an edge, of which the rounding of the edges leaves 9 (2) digits.
  if (tag == "needle") return {5e7, 5e7, 5e7};
  // Distances differ by up to 1e9 and the triangle is nearly seen edge-on: the far vertices' rounding counts.
  if (tag == "sun_slanted") return {600, 100, 100};
  if (tag == "slanted") return {32, 64, 64};
  // The point is rounded, with the offset, before its difference to the vertices is taken.
  if (tag == "stiff_offset") return {200, 32, 32};
  // The Hessian is the small difference of terms 1e-6 closer to the plane.
  if (tag == "near_plane_inside") return {32, 32, 64};
  return {};
}

template <typename Real, int Dim>
void expect_close(const Jet<double, Dim>& found, const Jet<double, Dim>& truth, const Bounds& bounds,
                  const std::string& tag) {
  const Errors error = errors<Dim>(found, truth);
  constexpr double epsilon = static_cast<double>(std::numeric_limits<Real>::epsilon());
  // Seen edge-on a triangle has form factor 0, of which only the absolute error can be small.
  if (std::abs(found.value - truth.value) > epsilon) {
    EXPECT_LE(error.value / epsilon, bounds.value) << tag;
  }
  EXPECT_LE(error.gradient / epsilon, bounds.gradient) << tag;
  EXPECT_LE(error.hessian / epsilon, bounds.hessian) << tag;
}

/// 2D and 3D fields can be held in float if they are neither too large nor too small for normal numbers.
template <int Dim>
bool fits_float(const Jet<double, Dim>& field) {
  double largest = 0;
  for (const double entry : field.hessian.entries) largest = std::max(largest, std::abs(entry));
  return largest > 1e-36 && largest < 1e36;
}

struct TriangleCase {
  std::string tag;
  RelativeTriangle<double> triangle;
  Jet3d truth;
};

std::vector<TriangleCase> triangle_cases() {
  std::vector<TriangleCase> result;
  for (const json& entry : cases("triangle3d")) {
    const json& v = entry.at("vertices");
    result.push_back({entry.at("tag"),
                      RelativeTriangle<double>::from_world(vector<3>(entry.at("point")), vector<3>(v.at(0)),
                                                           vector<3>(v.at(1)), vector<3>(v.at(2))),
                      jet<3>(entry)});
  }
  EXPECT_GE(result.size(), 129u);
  return result;
}

TEST(TriangleVectors, Double) {
  for (const auto& [tag, triangle, truth] : triangle_cases())
    expect_close<double, 3>(triangle_form_factor_jet(triangle), truth, triangle_bounds(tag), tag);
}

TEST(TriangleVectors, Float) {
  size_t compared = 0;
  for (const auto& [tag, triangle, truth] : triangle_cases()) {
    if (!fits_float(truth)) continue;
    ++compared;
    RelativeTriangle<float> rounded;
    for (size_t i = 0; i < 3; ++i) rounded.vertices[i] = Vec3f(triangle.vertices[i]);
    const auto& r = rounded.vertices;
    const auto widened = RelativeTriangle<double>::from_relative(Vec3d(r[0]), Vec3d(r[1]), Vec3d(r[2]));
    for (size_t i = 0; i < 3; ++i) rounded.edges[i] = Vec3f(widened.edges[i]);
    expect_close<float, 3>(widen(triangle_form_factor_jet(rounded)), triangle_form_factor_jet(widened),
                           triangle_bounds(tag), tag);
  }
  EXPECT_GE(compared, 115u);
}

TEST(TriangleVectors, EachFormWhereItIsChosenByOthers) {
  // Both forms hold everywhere else than in the other's domain (method.md section 4.3): ordinary triangles.
  for (const auto& [tag, triangle, truth] : triangle_cases()) {
    if (tag != "random" && tag != "slanted" && tag != "obtuse_over_pi") continue;
    const Bounds bounds{64, 64, 64};
    expect_close<double, 3>(triangle_form_factor_edges(triangle, scaled_vertices(triangle)), truth, bounds,
                            tag + ", edge form");
    expect_close<double, 3>(triangle_form_factor_arctangent(triangle, scaled_vertices(triangle)), truth,
                            bounds, tag + ", arctangent");
  }
}

template <typename Real>
void check_segments() {
  for (const json& entry : cases("segment2d")) {
    const std::string tag = entry.at("tag");
    const Vec2d point = vector<2>(entry.at("point"));
    const Vec2d first = vector<2>(entry.at("vertices").at(0));
    const Vec2d second = vector<2>(entry.at("vertices").at(1));
    Jet2d truth = jet<2>(entry);
    if constexpr (std::is_same_v<Real, double>) {
      expect_close<Real, 2>(segment_form_factor_jet(first - point, second - point, second - first), truth, {},
                            tag);
    } else {
      if (!fits_float(truth)) continue;
      const glm::vec<2, Real> r1(first - point);
      const glm::vec<2, Real> r2(second - point);
      const Vec2d edge = Vec2d(r2) - Vec2d(r1);
      truth = segment_form_factor_jet(Vec2d(r1), Vec2d(r2), edge);
      expect_close<Real, 2>(widen(segment_form_factor_jet(r1, r2, glm::vec<2, Real>(edge))), truth, {}, tag);
    }
  }
}

TEST(SegmentVectors, Double) { check_segments<double>(); }
TEST(SegmentVectors, Float) { check_segments<float>(); }

TEST(TransmittanceVectors, Double) {
  constexpr double epsilon = std::numeric_limits<double>::epsilon();
  for (const json& entry : cases("transmittance3d")) {
    const double sigma_t = entry.at("sigma_t");
    const Jet3d distance = distance_jet(vector<3>(entry.at("vertex")) - vector<3>(entry.at("point")));
    const Jet3d transmittance = transmittance_jet(sigma_t, distance);
    const Jet3d truth = jet<3>(entry.at("transmittance"));
    const double depth = sigma_t * distance.value;
    const std::string tag = "sigma_t " + std::to_string(sigma_t) + ", depth " + std::to_string(depth);
    if (truth.value < std::numeric_limits<double>::min()) {
      EXPECT_EQ(transmittance.value, 0) << tag;
      EXPECT_EQ(glm::length(transmittance.gradient), 0) << tag;
      EXPECT_EQ(transmittance.hessian.norm(), 0) << tag;
    } else {
      // The exponent's rounding is relative to the optical depth.
      const double bound = 8 + 2 * depth;
      expect_close<double, 3>(transmittance, truth, {bound, bound, 4 * bound}, tag);
    }
    const Jet3d integral = transmittance_integral_jet(sigma_t, distance);
    const Jet3d integral_truth = jet<3>(entry.at("integral"));
    EXPECT_NEAR(integral.value, integral_truth.value, 8 * epsilon * integral_truth.value) << tag;
    // Beyond, the derivatives are smaller than what differences of the value resolve.
    if (depth < 50) {
      const double bound = 8 + 2 * depth;
      expect_close<double, 3>(integral, integral_truth, {8, bound, 4 * bound}, tag);
    }
  }
}

TEST(AssemblyVectors, ClosedTriangulations) {
  for (const json& entry : cases("assembly3d")) {
    const std::string tag = entry.at("tag");
    const Vec3d point = vector<3>(entry.at("point"));
    const double sigma_t = entry.at("sigma_t");
    Jet3d sum;
    Jet3d magnitude;
    for (size_t t = 0; t < entry.at("triangles").size(); ++t) {
      const json& corners = entry.at("triangles").at(t);
      std::array<Vec3d, 3> v;
      for (size_t i = 0; i < 3; ++i) v[i] = vector<3>(entry.at("vertices").at(corners.at(i).get<size_t>()));
      const size_t farthest = entry.at("farthest").at(t);
      const Vec3d far = vector<3>(entry.at("vertices").at(farthest));
      const Jet3d form_factor =
          triangle_form_factor_jet(RelativeTriangle<double>::from_world(point, v[0], v[1], v[2]));
      const Jet3d term = transmittance_jet(sigma_t, distance_jet(far - point)) * form_factor *
                         entry.at("radiance").at(farthest).get<double>();
      sum += term;
      magnitude.value += std::abs(term.value);
      magnitude.gradient.x += glm::length(term.gradient);
      magnitude.hessian.entries[0] += term.hessian.norm();
    }
    const Jet3d truth = jet<3>(entry);
    // I2's tolerance.
    EXPECT_NEAR(sum.value, truth.value, 1e-13 * magnitude.value) << tag;
    EXPECT_LE(glm::length(sum.gradient - truth.gradient), 1e-13 * magnitude.gradient.x) << tag;
    EXPECT_LE((sum.hessian - truth.hessian).norm(), 1e-13 * magnitude.hessian.entries[0]) << tag;
  }
}

}  // namespace
}  // namespace fogbank::derivatives
