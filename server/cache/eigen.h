// Eigenvalues and eigenvectors of symmetric matrices.
#pragma once

#include <array>

#include "core/symmetric.h"

namespace fogbank::cache {

/// `matrix` = sum over k of values[k] vectors[k] vectors[k]^T; orthonormal, in no particular order.
template <int Dim>
struct Eigensystem {
  using Vector = glm::vec<Dim, double>;
  std::array<double, static_cast<size_t>(Dim)> values{};
  std::array<Vector, static_cast<size_t>(Dim)> vectors{};
};

/// Cyclic Jacobi rotations (Golub and Van Loan, "Matrix Computations", section 8.5): no case of repeated or
/// vanishing eigenvalues is special, and the vectors are orthonormal to rounding. Entries are finite. Dim = 2
/// or 3.
template <int Dim>
Eigensystem<Dim> eigen_decomposition(const Symmetric<double, Dim>& matrix);

extern template Eigensystem<2> eigen_decomposition<2>(const Symmetric<double, 2>&);
extern template Eigensystem<3> eigen_decomposition<3>(const Symmetric<double, 3>&);

}  // namespace fogbank::cache
