// Symmetric matrices, packed: Hessians.
#pragma once

#include <array>
#include <cmath>
#include <cstddef>
#include <glm/glm.hpp>

namespace fogbank {

/// Symmetric Dim x Dim matrix (Dim = 2 or 3), upper triangle row by row: (xx, xy, yy) or (xx, xy, xz, yy, yz,
/// zz).
template <typename Real, int Dim>
struct Symmetric {
  static_assert(Dim == 2 || Dim == 3);
  static constexpr int size = Dim * (Dim + 1) / 2;
  using Vector = glm::vec<Dim, Real>;

  std::array<Real, static_cast<size_t>(size)> entries{};

  /// Place of (row, column) in `entries`.
  static constexpr size_t index(int row, int column) {
    const int low = row < column ? row : column;
    const int high = row < column ? column : row;
    return static_cast<size_t>(low * Dim - low * (low - 1) / 2 + high - low);
  }
  Real operator()(int row, int column) const { return entries[index(row, column)]; }
  Real& operator()(int row, int column) { return entries[index(row, column)]; }

  static Symmetric identity(Real scale = 1) {
    Symmetric result;
    for (int i = 0; i < Dim; ++i) result(i, i) = scale;
    return result;
  }
  /// v v^T
  static Symmetric outer(const Vector& v) {
    Symmetric result;
    for (int i = 0; i < Dim; ++i)
      for (int j = i; j < Dim; ++j) result(i, j) = v[i] * v[j];
    return result;
  }
  /// a b^T + b a^T
  static Symmetric outer_sum(const Vector& a, const Vector& b) {
    Symmetric result;
    for (int i = 0; i < Dim; ++i)
      for (int j = i; j < Dim; ++j) result(i, j) = a[i] * b[j] + b[i] * a[j];
    return result;
  }

  Symmetric& operator+=(const Symmetric& other) {
    for (size_t i = 0; i < entries.size(); ++i) entries[i] += other.entries[i];
    return *this;
  }
  Symmetric& operator-=(const Symmetric& other) {
    for (size_t i = 0; i < entries.size(); ++i) entries[i] -= other.entries[i];
    return *this;
  }
  Symmetric& operator*=(Real scale) {
    for (Real& entry : entries) entry *= scale;
    return *this;
  }
  friend Symmetric operator+(Symmetric a, const Symmetric& b) { return a += b; }
  friend Symmetric operator-(Symmetric a, const Symmetric& b) { return a -= b; }
  friend Symmetric operator*(Symmetric a, Real scale) { return a *= scale; }
  friend Symmetric operator*(Real scale, Symmetric a) { return a *= scale; }
  friend Vector operator*(const Symmetric& matrix, const Vector& v) {
    Vector result(0);
    for (int i = 0; i < Dim; ++i)
      for (int j = 0; j < Dim; ++j) result[i] += matrix(i, j) * v[j];
    return result;
  }

  Real trace() const {
    Real sum = 0;
    for (int i = 0; i < Dim; ++i) sum += (*this)(i, i);
    return sum;
  }
  /// Frobenius norm.
  Real norm() const {
    Real sum = 0;
    for (int i = 0; i < Dim; ++i)
      for (int j = 0; j < Dim; ++j) sum += (*this)(i, j) * (*this)(i, j);
    return std::sqrt(sum);
  }
};

using Symmetric3d = Symmetric<double, 3>;
using Symmetric3f = Symmetric<float, 3>;

}  // namespace fogbank
