#include "cache/eigen.h"

#include <gtest/gtest.h>

#include <algorithm>

#include "core/random.h"

namespace fogbank::cache {
namespace {

/// Worst deviation from A = V diag(values) V^T and V^T V = I, relative to the greatest entry.
template <int Dim>
double defect(const Symmetric<double, Dim>& matrix, const Eigensystem<Dim>& system) {
  double scale = 0;
  for (const double entry : matrix.entries) scale = std::max(scale, std::fabs(entry));
  double worst = 0;
  for (int i = 0; i < Dim; ++i) {
    for (int j = 0; j < Dim; ++j) {
      double entry = 0;
      for (size_t k = 0; k < Dim; ++k)
        entry += system.values[k] * system.vectors[k][i] * system.vectors[k][j];
      if (scale > 0) worst = std::max(worst, std::fabs(entry / scale - matrix(i, j) / scale));
      const double product =
          glm::dot(system.vectors[static_cast<size_t>(i)], system.vectors[static_cast<size_t>(j)]);
      worst = std::max(worst, std::fabs(product - (i == j ? 1 : 0)));
    }
  }
  return worst;
}

// A few roundings in each of some 15 rotations.
constexpr double tolerance = 1e-14;

TEST(EigenDecomposition, RandomMatricesOfAllScales) {
  RandomStream random(1, 0, 0, 0);
  for (const double scale : {1e-300, 1e-30, 1.0, 1e30, 1e300}) {
    for (int i = 0; i < 200; ++i) {
      Symmetric3d three;
      for (double& entry : three.entries) entry = scale * (2 * static_cast<double>(random.next_float()) - 1);
      EXPECT_LT(defect(three, eigen_decomposition(three)), tolerance);
      Symmetric<double, 2> two;
      for (double& entry : two.entries) entry = scale * (2 * static_cast<double>(random.next_float()) - 1);
      EXPECT_LT(defect(two, eigen_decomposition(two)), tolerance);
    }
  }
}

TEST(EigenDecomposition, RepeatedAndVanishingEigenvalues) {
  const glm::dvec3 direction = glm::normalize(glm::dvec3(1, 2, -3));
  const Symmetric3d projector = Symmetric3d::outer(direction);
  for (const Symmetric3d& matrix :
       {Symmetric3d{}, Symmetric3d::identity(2.0), projector, Symmetric3d::identity() - projector,
        Symmetric3d::identity() + projector * 1e-12, projector * 1e12 + Symmetric3d::identity(1e-6)}) {
    EXPECT_LT(defect(matrix, eigen_decomposition(matrix)), tolerance);
  }
  Eigensystem<3> system = eigen_decomposition(projector);
  std::sort(system.values.begin(), system.values.end());
  EXPECT_NEAR(system.values[0], 0, tolerance);
  EXPECT_NEAR(system.values[1], 0, tolerance);
  EXPECT_NEAR(system.values[2], 1, tolerance);
}

TEST(EigenDecomposition, DiagonalMatricesAreLeftAlone) {
  Symmetric3d matrix;
  matrix(0, 0) = 3;
  matrix(1, 1) = -1;
  matrix(2, 2) = 0;
  const Eigensystem<3> system = eigen_decomposition(matrix);
  EXPECT_EQ(system.values[0], 3);
  EXPECT_EQ(system.values[1], -1);
  EXPECT_EQ(system.values[2], 0);
}

}  // namespace
}  // namespace fogbank::cache
