// Gauss-Legendre quadrature.
#pragma once

#include <array>
#include <cmath>
#include <numbers>

namespace fogbank::derivatives::flatland {

/// Nodes and weights on [0, 1]; exact for polynomials of degree 2 Count - 1.
template <int Count>
struct GaussLegendre {
  std::array<double, Count> nodes{};
  std::array<double, Count> weights{};

  /// Newton's method on the Legendre polynomial P_Count, from the asymptotic places of its zeros (Abramowitz
  /// and Stegun 1964, 22.16.6 and 25.4.29).
  GaussLegendre() {
    for (int i = 0; i < Count; ++i) {
      double z = std::cos(std::numbers::pi * (i + 0.75) / (Count + 0.5));
      double slope = 0;
      for (int step = 0; step < 8; ++step) {
        double before = 1;
        double here = z;
        for (int degree = 2; degree <= Count; ++degree) {
          const double next = ((2 * degree - 1) * z * here - (degree - 1) * before) / degree;
          before = here;
          here = next;
        }
        slope = Count * (z * here - before) / (z * z - 1);
        z -= here / slope;
      }
      nodes[static_cast<size_t>(i)] = (1 - z) / 2;
      weights[static_cast<size_t>(i)] = 1 / ((1 - z * z) * slope * slope);
    }
  }

  static const GaussLegendre& rule() {
    static const GaussLegendre instance;
    return instance;
  }
};

}  // namespace fogbank::derivatives::flatland
