// The cosine-weighted form factor against high-precision answers, and what holds for any surroundings.
#include <gtest/gtest.h>

#include <fstream>
#include <nlohmann/json.hpp>

#include "core/random.h"
#include "core/sampling.h"
#include "derivatives/hemisphere_grid.h"
#include "derivatives/irradiance_edge.h"

namespace fogbank::derivatives {
namespace {

using nlohmann::json;

Vec3d vector(const json& numbers) {
  return {numbers.at(0).get<double>(), numbers.at(1).get<double>(), numbers.at(2).get<double>()};
}

TEST(IrradianceFormFactor, AgreesWithHighPrecision) {
  // Relative to the root of the repository, where CTest runs.
  std::ifstream file("tests/numerics/vectors/irradiance3d.json");
  for (const json& entry : json::parse(file).at("cases")) {
    SCOPED_TRACE(entry.at("tag").get<std::string>());
    const json& vertices = entry.at("vertices");
    const Jet3d found = irradiance_form_factor(vector(vertices.at(0)), vector(vertices.at(1)),
                                               vector(vertices.at(2)), vector(entry.at("normal")));
    // The terms of a small triangle's edges cancel: of the size of its sides (1e-4 of the distance at least,
    // among the cases) the value keeps the square, and each derivative as much, in the worst direction.
    const double tolerance = entry.at("tag") == "far" ? 1e-6 : 1e-10;
    const double value = entry.at("value").get<double>();
    EXPECT_NEAR(found.value, value, tolerance * std::fabs(value));
    const Vec3d gradient = vector(entry.at("gradient"));
    EXPECT_LE(glm::length(found.gradient - gradient), tolerance * glm::length(gradient));
    Symmetric3d hessian;
    for (size_t i = 0; i < 6; ++i) hessian.entries[i] = entry.at("hessian").at(i).get<double>();
    EXPECT_LE((found.hessian - hessian).norm(), tolerance * hessian.norm());
  }
}

TEST(IrradianceFormFactor, OppositeEdgesCancel) {
  const Vec3d a(0.3, -0.2, 1.1);
  const Vec3d b(-0.7, 0.4, 0.6);
  const Vec3d normal(0, 0, 1);
  const Jet3d sum = irradiance_edge_term(a, b, normal) + irradiance_edge_term(b, a, normal);
  // Some roundings of numbers of about 1.
  EXPECT_NEAR(sum.value, 0, 1e-15);
  EXPECT_NEAR(glm::length(sum.gradient), 0, 1e-15);
  EXPECT_NEAR(sum.hessian.norm(), 0, 1e-15);
}

TEST(IrradianceFormFactor, SeriesMeetsClosedForm) {
  // Both forms of the angle over its sine and its derivatives on either side of where they meet.
  const AngleOverSine<double> series(1 - 1.9999e-3);
  const AngleOverSine<double> closed(1 - 2.0001e-3);
  EXPECT_NEAR(series.value, closed.value, 1e-7);
  EXPECT_NEAR(series.first, closed.first, 1e-7);
  EXPECT_NEAR(series.second, closed.second, 1e-6);
}

TEST(HemisphereGrid, FillsTheHemisphereWhateverTheDistances) {
  // Uniform radiance from all around is the same everywhere on the surface: form factors add up to 1, and
  // their derivatives along the surface to 0, with jitter, random distances and all.
  for (const uint32_t n : {2u, 5u, 16u}) {
    const auto grid = HemisphereGrid::of(n);
    RandomStream random(3, n, 0, 0);
    std::vector<Vec3d> vertices;
    for (uint32_t v = 0; v < grid->vertex_count(); ++v)
      vertices.push_back(Vec3d(grid->direction(v, random.next_vec2())) * (0.2 + random.next_float()));
    Jet3d sum;
    double gradients = 0;
    double hessians = 0;
    for (const HemisphereGrid::Triangle& t : grid->triangles()) {
      const Jet3d form =
          irradiance_form_factor(vertices[t[0]], vertices[t[1]], vertices[t[2]], Vec3d(0, 0, 1));
      sum += form;
      gradients += glm::length(form.gradient);
      hessians += form.hessian.norm();
    }
    EXPECT_NEAR(sum.value, 1, 1e-12);
    EXPECT_LE(std::hypot(sum.gradient.x, sum.gradient.y), 1e-12 * gradients);
    EXPECT_LE(
        std::max({std::fabs(sum.hessian(0, 0)), std::fabs(sum.hessian(0, 1)), std::fabs(sum.hessian(1, 1))}),
        1e-12 * hessians);
  }
}

TEST(HemisphereGrid, TopologyIsADisk) {
  for (const uint32_t n : {2u, 3u, 8u, 17u}) {
    const auto grid = HemisphereGrid::of(n);
    // Euler: a disk.
    EXPECT_EQ(grid->vertex_count() + grid->triangles().size(), grid->edges().size() + 1);
    EXPECT_EQ(grid->vertex_count(), n * n + 4 * (n + 1));
    size_t at_horizon = 0;
    for (const HemisphereGrid::Edge& edge : grid->edges())
      at_horizon += edge.right == HemisphereGrid::no_triangle;
    EXPECT_EQ(at_horizon, 4 * (n + 1));
    for (const HemisphereGrid::Edge& edge : grid->inner_edges())
      EXPECT_TRUE(edge.a < grid->cell_count() && edge.b < grid->cell_count());
    for (size_t t = 0; t < grid->triangles().size(); ++t)
      for (size_t k = 0; k < 3; ++k) {
        const HemisphereGrid::Edge& edge = grid->edges()[grid->triangle_edges()[t][k]];
        EXPECT_EQ(std::minmax(edge.a, edge.b),
                  std::minmax(grid->triangles()[t][k], grid->triangles()[t][(k + 1) % 3]));
      }
    for (uint32_t v = 0; v < grid->vertex_count(); ++v) {
      const Vec3f direction = grid->direction(v, Vec2f(0.5f));
      EXPECT_NEAR(glm::length(direction), 1, 1e-6f);
      EXPECT_EQ(direction.z == 0, v >= grid->cell_count());
      // The cell next to a vertex of the horizon is the one with the direction most like it.
      EXPECT_GT(glm::dot(direction, grid->direction(grid->parent(v), Vec2f(0.5f))), n < 8 ? 0.3f : 0.8f);
    }
  }
}

TEST(HemisphereGrid, CellsAreEqualSharesOfIrradiance) {
  // Uniform places in cells are cosine-distributed directions: moments of the cosine of E[z] = 2/3,
  // E[z^2] = 1/2.
  const auto grid = HemisphereGrid::of(8);
  RandomStream random(5, 0, 0, 0);
  double first = 0;
  double second = 0;
  constexpr int repeats = 400;
  for (int k = 0; k < repeats; ++k)
    for (uint32_t v = 0; v < grid->cell_count(); ++v) {
      const auto z = static_cast<double>(grid->direction(v, random.next_vec2()).z);
      first += z;
      second += z * z;
    }
  const double count = 64.0 * repeats;
  // Four standard deviations of independent samples, which strata stay below.
  EXPECT_NEAR(first / count, 2.0 / 3, 4 * std::sqrt(1.0 / 18 / count));
  EXPECT_NEAR(second / count, 0.5, 4 * std::sqrt(1.0 / 12 / count));
}

}  // namespace
}  // namespace fogbank::derivatives
