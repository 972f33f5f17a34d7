// Shells of a medium against high-precision answers (tests/numerics/vectors/shells3d.json), moments against
// the shells that they stand for, linear sources against differences.
#include "derivatives/medium_shells.h"

#include <gtest/gtest.h>

#include <fstream>
#include <nlohmann/json.hpp>

#include "derivatives/closed_surroundings.h"
#include "derivatives/medium_reference.h"

namespace fogbank::derivatives {
namespace {

using nlohmann::json;
using test::uniform;
using test::uniform_direction;

template <typename Real>
glm::vec<3, Real> vector(const json& numbers) {
  return glm::vec<3, Real>(Vec3d(numbers.at(0), numbers.at(1), numbers.at(2)));
}

/// exp(-sigma_t d) over its value at a vertex fixed in the world.
template <typename Real>
Jet<Real, 3> relative_transmittance(Real sigma_t, const glm::vec<3, Real>& vertex) {
  return chain(distance_jet(vertex), Real(1), -sigma_t, sigma_t * sigma_t);
}

/// The plain rule of method.md section 8.1: every shell by itself, outlines at the rays' own ends, a constant
/// source with the farthest end.
template <typename Real>
Jet<Real, 3> plain_shells(const json& shells) {
  using Vector = glm::vec<3, Real>;
  const Real sigma_t = shells.at("sigma_t").get<Real>();
  const Real step = shells.at("step").get<Real>();
  const Real subtracted = shells.at("subtracted").get<Real>();
  Jet<Real, 3> sum;
  for (const json& corners : shells.at("triangles")) {
    std::array<Vector, 3> directions;
    std::array<Real, 3> ends;
    std::array<const json*, 3> sources{};
    for (size_t i = 0; i < 3; ++i) {
      const size_t ray = corners.at(i).get<size_t>();
      directions[i] = vector<Real>(shells.at("directions").at(ray));
      ends[i] = shells.at("ends").at(ray).get<Real>();
      sources[i] = &shells.at("source").at(ray);
    }
    const auto last = [&](size_t i) { return directions[i] * ends[i]; };
    const auto farthest = static_cast<size_t>(std::max_element(ends.begin(), ends.end()) - ends.begin());
    sum += linear_source_jet(sigma_t, last(farthest), subtracted, Vector(0)) *
           triangle_form_factor_jet(RelativeTriangle<Real>::from_relative(last(0), last(1), last(2)));
    for (size_t k = 0; k < sources[0]->size(); ++k) {
      const Real distance = (static_cast<Real>(k) + Real(0.5)) * step;
      const auto alive = std::count_if(ends.begin(), ends.end(), [&](Real end) { return end > distance; });
      if (alive == 0) continue;
      const Jet<Real, 3> form = polygon_form_factor(
          lit_polygon(directions, ends, distance, [&](size_t ended, size_t) { return last(ended); }));
      for (size_t i = 0; i < 3; ++i) {
        if (!(ends[i] > distance)) continue;
        const Real weight = step * transmittance(sigma_t, distance) *
                            (sources[i]->at(k).get<Real>() - subtracted) / static_cast<Real>(alive);
        sum += relative_transmittance(sigma_t, directions[i] * distance) * form * weight;
      }
    }
  }
  return sum * shells.at("sigma_s").get<Real>();
}

template <typename Real>
void expect_vectors(double value_tolerance, double gradient_tolerance, double hessian_tolerance) {
  std::ifstream file("tests/numerics/vectors/shells3d.json");
  for (const json& shells : json::parse(file).at("cases")) {
    SCOPED_TRACE(shells.at("tag").get<std::string>());
    const Jet<Real, 3> jet = plain_shells<Real>(shells);
    const double value = shells.at("value");
    const auto gradient = vector<double>(shells.at("gradient"));
    Symmetric3d difference;
    Symmetric3d hessian;
    for (size_t i = 0; i < hessian.entries.size(); ++i) {
      hessian.entries[i] = shells.at("hessian").at(i);
      difference.entries[i] = static_cast<double>(jet.hessian.entries[i]) - hessian.entries[i];
    }
    EXPECT_NEAR(static_cast<double>(jet.value), value, value_tolerance * std::abs(value));
    EXPECT_LT(glm::length(Vec3d(jet.gradient) - gradient), gradient_tolerance * glm::length(gradient));
    EXPECT_LT(difference.norm(), hessian_tolerance * hessian.norm());
  }
}

TEST(ShellVectors, DoubleAgrees) {
  // Rounding, times what cancels between a few hundred terms.
  expect_vectors<double>(1e-14, 1e-13, 1e-13);
}
TEST(ShellVectors, FloatAgrees) { expect_vectors<float>(1e-5, 1e-4, 1e-4); }

/// Section 8.4 of method.md: what rays add up to is what their shells do, each by itself, with the
/// path-length term of section 8.3.
template <typename Real>
void expect_moments_to_be_shells(double tolerance) {
  using Vector = glm::vec<3, Real>;
  using Matrix = Symmetric<Real, 3>;
  RandomStream random(21, 0, 0, 0);
  for (int i = 0; i < 1000; ++i) {
    const Vec3d centre = uniform_direction(random);
    std::array<Vector, 3> directions;
    for (Vector& direction : directions)
      direction = glm::normalize(Vector(centre + 0.1 * uniform_direction(random)));
    const Vector& u = directions[0];
    const auto sigma_t = static_cast<Real>(uniform(random, 0, 3));
    ShellMoments<Real> moments;
    std::array<Real, 3> sums{};
    Jet<Real, 3> shells;
    Real size = 0;
    for (int k = 0; k < 10; ++k) {
      const auto distance = static_cast<Real>(uniform(random, 0.1, 4));
      const auto weight = static_cast<Real>(uniform(random, -1, 1));
      for (size_t power = 0; power < 3; ++power)
        sums[power] += weight * std::pow(distance, -static_cast<Real>(power));
      const Jet<Real, 3> form = triangle_form_factor_jet(RelativeTriangle<Real>::from_relative(
          directions[0] * distance, directions[1] * distance, directions[2] * distance));
      Jet<Real, 3> shell = relative_transmittance(sigma_t, u * distance) * form;
      shell.hessian += (Matrix::identity() - Matrix::outer(u)) * (form.value / distance / distance);
      shells += shell * weight;
      size += std::abs(weight) * form.value * (1 + sigma_t * sigma_t + 20 / distance / distance);
      // Half of the samples one by one, as if they lay behind boundaries.
      if (k % 2 == 1) {
        moments.add_sample(weight, distance, relative_transmittance(sigma_t, u * distance));
        for (size_t power = 0; power < 3; ++power)
          sums[power] -= weight * std::pow(distance, -static_cast<Real>(power));
      }
    }
    moments.add_homogeneous(u, sigma_t, sums[0], sums[1], sums[0], sums[1], sums[2]);
    const Jet<Real, 3> jet = shell_jet(triangle_form_factor_jet(RelativeTriangle<Real>::from_relative(
                                           directions[0], directions[1], directions[2])),
                                       u, moments);
    EXPECT_LT(glm::length(jet.gradient - shells.gradient), tolerance * std::abs(size));
    EXPECT_LT((jet.hessian - shells.hessian).norm(), tolerance * std::abs(size));
  }
}

TEST(ShellMoments, AreSumsOfShells) {
  expect_moments_to_be_shells<double>(1e-12);
  expect_moments_to_be_shells<float>(1e-3);
}

/// Values against quadrature, derivatives against differences of values.
TEST(LinearSource, AgreesWithQuadratureAndDifferences) {
  const test::Quadrature rule(30);
  RandomStream random(22, 0, 0, 0);
  for (int i = 0; i < 300; ++i) {
    // From clear to several mean free paths, through where series and closed form meet.
    const double sigma_t = std::pow(10, uniform(random, -7, 0.7));
    const Vec3d vertex = uniform_direction(random) * uniform(random, 0.5, 2);
    const double value = uniform(random, 0, 2);
    const Vec3d slope = uniform_direction(random);
    const auto integral = [&](const Vec3d& x) {
      const double d = glm::length(vertex - x);
      return rule.integrate(0, d, [&](double s) {
        return std::exp(-sigma_t * s) * (value + glm::dot(slope, x + (vertex - x) * (s / d)));
      });
    };
    const Jet3d jet = linear_source_jet(sigma_t, vertex, value, slope);
    const Jet3d truth = test::differences(integral, Vec3d(0), 2e-2);
    EXPECT_NEAR(jet.value, truth.value, 1e-13);
    // Differences: h^4 of fields that change over half a unit, and rounding over h^2.
    EXPECT_LT(glm::length(jet.gradient - truth.gradient), 2e-6);
    EXPECT_LT((jet.hessian - truth.hessian).norm(), 2e-5);
    const Jet<float, 3> narrow = linear_source_jet(static_cast<float>(sigma_t), Vec3f(vertex),
                                                   static_cast<float>(value), Vec3f(slope));
    EXPECT_NEAR(static_cast<double>(narrow.value), jet.value, 1e-5);
    EXPECT_LT(glm::length(Vec3d(narrow.gradient) - jet.gradient), 1e-4);
    for (size_t k = 0; k < 6; ++k)
      EXPECT_NEAR(static_cast<double>(narrow.hessian.entries[k]), jet.hessian.entries[k], 1e-3);
  }
}

}  // namespace
}  // namespace fogbank::derivatives
