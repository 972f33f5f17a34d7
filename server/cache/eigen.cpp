#include "cache/eigen.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace fogbank::cache {

template <int Dim>
Eigensystem<Dim> eigen_decomposition(const Symmetric<double, Dim>& matrix) {
  Eigensystem<Dim> result;
  for (int k = 0; k < Dim; ++k) result.vectors[static_cast<size_t>(k)][k] = 1;

  // A power of two, so that squares neither overflow nor vanish and nothing is rounded.
  double largest = 0;
  for (const double entry : matrix.entries) largest = std::max(largest, std::fabs(entry));
  if (largest == 0) return result;
  int exponent = 0;
  std::frexp(largest, &exponent);
  Symmetric<double, Dim> a;
  for (size_t i = 0; i < a.entries.size(); ++i) a.entries[i] = std::ldexp(matrix.entries[i], -exponent);

  // Converges quadratically: 3 to 5 sweeps; the limit is there for the compiler of proofs only.
  constexpr double negligible = std::numeric_limits<double>::epsilon() / 8;
  for (int sweep = 0; sweep < 32; ++sweep) {
    bool done = true;
    for (int p = 0; p < Dim; ++p) {
      for (int q = p + 1; q < Dim; ++q) {
        if (std::fabs(a(p, q)) <= negligible) continue;
        done = false;
        const double theta = (a(q, q) - a(p, p)) / (2 * a(p, q));
        const double t = std::copysign(1.0, theta) / (std::fabs(theta) + std::sqrt(1 + theta * theta));
        const double c = 1 / std::sqrt(1 + t * t);
        const double s = t * c;
        a(p, p) -= t * a(p, q);
        a(q, q) += t * a(p, q);
        a(p, q) = 0;
        for (int k = 0; k < Dim; ++k) {
          double& vp = result.vectors[static_cast<size_t>(p)][k];
          double& vq = result.vectors[static_cast<size_t>(q)][k];
          const double old_vp = vp;
          vp = c * old_vp - s * vq;
          vq = s * old_vp + c * vq;
          if (k == p || k == q) continue;
          const double akp = a(k, p);
          const double akq = a(k, q);
          a(k, p) = c * akp - s * akq;
          a(k, q) = s * akp + c * akq;
        }
      }
    }
    if (done) break;
  }
  for (int k = 0; k < Dim; ++k) result.values[static_cast<size_t>(k)] = std::ldexp(a(k, k), exponent);
  return result;
}

template Eigensystem<2> eigen_decomposition<2>(const Symmetric<double, 2>&);
template Eigensystem<3> eigen_decomposition<3>(const Symmetric<double, 3>&);

}  // namespace fogbank::cache
