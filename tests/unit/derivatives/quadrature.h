// Gauss-Legendre quadrature and fourth-order differences, for references.
#pragma once

#include <array>
#include <cmath>
#include <numbers>
#include <vector>

#include "core/vector.h"
#include "derivatives/jet.h"

namespace fogbank::derivatives::test {

/// Nodes and weights on [0, 1] by Newton's iteration on the Legendre polynomial.
inline std::vector<std::array<double, 2>> gauss_legendre(int count) {
  std::vector<std::array<double, 2>> nodes;
  for (int i = 0; i < count; ++i) {
    double z = std::cos(std::numbers::pi * (i + 0.75) / (count + 0.5));
    double slope = 1;
    for (int iteration = 0; iteration < 100; ++iteration) {
      double p = 1;
      double before = 0;
      for (int k = 1; k <= count; ++k) {
        const double next = ((2 * k - 1) * z * p - (k - 1) * before) / k;
        before = p;
        p = next;
      }
      slope = count * (z * p - before) / (z * z - 1);
      const double step = p / slope;
      z -= step;
      if (std::fabs(step) < 1e-15) break;
    }
    nodes.push_back({0.5 * (1 - z), 1 / ((1 - z * z) * slope * slope)});
  }
  return nodes;
}

/// Integral of f over [lower, upper]; exact to rounding for what is smooth on the scale of the nodes.
template <typename F>
double integrate(const std::vector<std::array<double, 2>>& nodes, double lower, double upper, const F& f) {
  double sum = 0;
  for (const auto& [u, w] : nodes) sum += w * f(lower + (upper - lower) * u);
  return sum * (upper - lower);
}

/// Value, gradient and Hessian of f at x by fourth-order central differences of step h.
template <typename F>
Jet3d differentiate(const F& f, const Vec3d& x, double h) {
  // Weights of f(x - 2h) .. f(x + 2h).
  constexpr std::array<double, 5> first{1.0 / 12, -2.0 / 3, 0, 2.0 / 3, -1.0 / 12};
  constexpr std::array<double, 5> second{-1.0 / 12, 4.0 / 3, -5.0 / 2, 4.0 / 3, -1.0 / 12};
  Jet3d jet;
  jet.value = f(x);
  const auto at = [&](int i, int steps_i, int j, int steps_j) {
    Vec3d moved = x;
    moved[i] += steps_i * h;
    moved[j] += steps_j * h;
    return f(moved);
  };
  for (int i = 0; i < 3; ++i) {
    for (int s = -2; s <= 2; ++s) {
      const double sample = s == 0 ? jet.value : at(i, s, i, 0);
      jet.gradient[i] += first[static_cast<size_t>(s + 2)] * sample / h;
      jet.hessian(i, i) += second[static_cast<size_t>(s + 2)] * sample / (h * h);
    }
    for (int j = i + 1; j < 3; ++j) {
      for (int s = -2; s <= 2; ++s) {
        for (int t = -2; t <= 2; ++t) {
          if (s == 0 || t == 0) continue;
          jet.hessian(i, j) += first[static_cast<size_t>(s + 2)] * first[static_cast<size_t>(t + 2)] *
                               at(i, s, j, t) / (h * h);
        }
      }
    }
  }
  return jet;
}

}  // namespace fogbank::derivatives::test
