// Light from a medium with a given source, by dense quadrature: M_med(x) = 1/(4 pi) sum over patches of the
// integral of cos / d^2 times the light along the way to each of their points. Patches stay put while x
// moves, so every integrand is smooth, and so are differences of the sum.
#pragma once

#include <array>
#include <cmath>
#include <functional>
#include <vector>

#include "derivatives/jet.h"

namespace fogbank::test {

/// Gauss-Legendre rule on [0, 1] (Newton's method on the Legendre polynomial).
struct Quadrature {
  std::vector<double> nodes;
  std::vector<double> weights;

  explicit Quadrature(int n) {
    for (int i = 0; i < n; ++i) {
      double z = std::cos(M_PI * (i + 0.75) / (n + 0.5));
      double slope = 0;
      for (int iteration = 0; iteration < 50; ++iteration) {
        double value = 1;
        double before = 0;
        for (int j = 0; j < n; ++j) {
          const double last = before;
          before = value;
          value = ((2 * j + 1) * z * before - j * last) / (j + 1);
        }
        slope = n * (z * value - before) / (z * z - 1);
        z -= value / slope;
      }
      nodes.push_back(0.5 * (1 - z));
      weights.push_back(1 / ((1 - z * z) * slope * slope));
    }
  }
  double integrate(double begin, double end, const std::function<double(double)>& f) const {
    double sum = 0;
    for (size_t i = 0; i < nodes.size(); ++i) sum += weights[i] * f(begin + (end - begin) * nodes[i]);
    return sum * (end - begin);
  }
};

/// A parallelogram with the light that comes along the way to (or from) its points; `light(x, p)`.
struct Patch {
  Vec3d corner;
  Vec3d a;
  Vec3d b;
  std::function<double(const Vec3d&, const Vec3d&)> light;
  int pieces = 1;  ///< along each side, for what isn't smooth all over
};

inline double mean_over_sphere(const std::vector<Patch>& patches, const Vec3d& x, const Quadrature& rule) {
  double sum = 0;
  for (const Patch& patch : patches) {
    const Vec3d area = glm::cross(patch.a, patch.b);
    const double share = 1.0 / patch.pieces;
    for (int piece = 0; piece < patch.pieces * patch.pieces; ++piece) {
      const Vec2d first(piece % patch.pieces * share, std::floor(piece * share) * share);
      for (size_t i = 0; i < rule.nodes.size(); ++i) {
        for (size_t j = 0; j < rule.nodes.size(); ++j) {
          const Vec3d p = patch.corner + patch.a * (first.x + share * rule.nodes[i]) +
                          patch.b * (first.y + share * rule.nodes[j]);
          const Vec3d r = p - x;
          const double d = glm::length(r);
          sum += rule.weights[i] * rule.weights[j] * share * share * std::abs(glm::dot(area, r)) /
                 (d * d * d) * patch.light(x, p);
        }
      }
    }
  }
  return sum / (4 * M_PI);
}

/// Central differences of steps h and h / 2 with one Richardson extrapolation: error O(h^4).
inline derivatives::Jet3d differences(const std::function<double(const Vec3d&)>& field, const Vec3d& x,
                                      double h) {
  const auto with_step = [&](double step) {
    derivatives::Jet3d jet;
    jet.value = field(x);
    for (int i = 0; i < 3; ++i) {
      Vec3d e(0);
      e[i] = step;
      const double above = field(x + e);
      const double below = field(x - e);
      jet.gradient[i] = (above - below) / (2 * step);
      jet.hessian(i, i) = (above - 2 * jet.value + below) / (step * step);
      for (int j = i + 1; j < 3; ++j) {
        Vec3d f(0);
        f[j] = step;
        jet.hessian(i, j) =
            (field(x + e + f) - field(x + e - f) - field(x - e + f) + field(x - e - f)) / (4 * step * step);
      }
    }
    return jet;
  };
  return with_step(h / 2) * (4.0 / 3) - with_step(h) * (1.0 / 3);
}

}  // namespace fogbank::test
