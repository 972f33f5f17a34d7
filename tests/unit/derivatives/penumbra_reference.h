// The direct light of scenes/penumbra without rays, grids or form factors: what the two plates leave of the
// ceiling light is a sum of rectangles, each integrated by Gauss-Legendre quadrature.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <vector>

#include "derivatives/jet.h"

namespace fogbank::derivatives::test {

/// Axis-aligned, across z; empty when lower >= upper.
struct LevelRectangle {
  double lower_x, upper_x, lower_y, upper_y;

  bool empty() const { return lower_x >= upper_x || lower_y >= upper_y; }
  double area() const { return empty() ? 0 : (upper_x - lower_x) * (upper_y - lower_y); }
  friend LevelRectangle operator&(const LevelRectangle& a, const LevelRectangle& b) {
    return {std::max(a.lower_x, b.lower_x), std::min(a.upper_x, b.upper_x), std::max(a.lower_y, b.lower_y),
            std::min(a.upper_y, b.upper_y)};
  }
};

/// Nodes and weights on [0, 1] by Newton's iteration on the Legendre polynomial.
inline std::vector<std::array<double, 2>> gauss_legendre(int count) {
  std::vector<std::array<double, 2>> nodes;
  for (int i = 0; i < count; ++i) {
    double z = std::cos(3.141592653589793 * (i + 0.75) / (count + 0.5));
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

/// A level light that shines down over level plates in a homogeneous medium. Radiance 1.
class PenumbraReference {
 public:
  struct Plate {
    LevelRectangle extent;
    double z;
  };

  PenumbraReference(LevelRectangle light, double light_z, std::vector<Plate> plates, double sigma_t)
      : light_(light), light_z_(light_z), plates_(std::move(plates)), sigma_t_(sigma_t) {}

  /// scenes/penumbra/penumbra.xml.
  static PenumbraReference of_scene(double sigma_t) {
    return {
        {-0.5, 0.5, -0.5, 0.5}, 1.995, {{{-1.2, 0.1, -0.8, 0.8}, 1}, {{0.6, 1.2, -0.5, 0.5}, 0.3}}, sigma_t};
  }

  /// Share of the light's area that x sees.
  double visible_share(const Vec3d& x) const {
    double area = 0;
    for_each_piece(x, [&](const LevelRectangle& piece, double sign) { area += sign * piece.area(); });
    return area / light_.area();
  }

  /// Mean radiance at x, below the light.
  double value(const Vec3d& x) const {
    double sum = 0;
    for_each_piece(x, [&](const LevelRectangle& piece, double sign) { sum += sign * integral(piece, x); });
    return sum;
  }

  /// By fourth-order central differences with steps h and h / 2; `reliable` tells whether they agree (no
  /// kink near).
  Jet3d jet(const Vec3d& x, bool& reliable) const {
    const Jet3d coarse = differences(x, 2e-3);
    const Jet3d fine = differences(x, 1e-3);
    reliable = glm::length(coarse.gradient - fine.gradient) <= 1e-5 * glm::length(fine.gradient) + 1e-12 &&
               (coarse.hessian - fine.hessian).norm() <= 1e-4 * fine.hessian.norm() + 1e-8;
    return fine;
  }

 private:
  /// Inclusion and exclusion over the plates' shadows on the light's plane.
  template <typename Visit>
  void for_each_piece(const Vec3d& x, const Visit& visit) const {
    for (size_t subset = 0; subset < (size_t{1} << plates_.size()); ++subset) {
      LevelRectangle piece = light_;
      double sign = 1;
      bool shadows = true;
      for (size_t i = 0; i < plates_.size(); ++i) {
        if ((subset >> i & 1) == 0) continue;
        sign = -sign;
        shadows = shadows && plates_[i].z > x.z;
        const double t = (light_z_ - x.z) / (plates_[i].z - x.z);
        const LevelRectangle& plate = plates_[i].extent;
        piece = piece & LevelRectangle{x.x + (plate.lower_x - x.x) * t, x.x + (plate.upper_x - x.x) * t,
                                       x.y + (plate.lower_y - x.y) * t, x.y + (plate.upper_y - x.y) * t};
      }
      if (shadows && !piece.empty()) visit(piece, sign);
    }
  }

  double integral(const LevelRectangle& piece, const Vec3d& x) const {
    static const std::vector<std::array<double, 2>> nodes = gauss_legendre(24);
    const double height = light_z_ - x.z;
    double sum = 0;
    for (const auto& [u, wu] : nodes) {
      for (const auto& [v, wv] : nodes) {
        const double dx = piece.lower_x + (piece.upper_x - piece.lower_x) * u - x.x;
        const double dy = piece.lower_y + (piece.upper_y - piece.lower_y) * v - x.y;
        const double squared = dx * dx + dy * dy + height * height;
        const double distance = std::sqrt(squared);
        sum += wu * wv * height / (squared * distance) * std::exp(-sigma_t_ * distance);
      }
    }
    return sum * piece.area() / (4 * 3.141592653589793);
  }

  Jet3d differences(const Vec3d& x, double h) const {
    // Weights of f(x - 2h) .. f(x + 2h).
    constexpr std::array<double, 5> first{1.0 / 12, -2.0 / 3, 0, 2.0 / 3, -1.0 / 12};
    constexpr std::array<double, 5> second{-1.0 / 12, 4.0 / 3, -5.0 / 2, 4.0 / 3, -1.0 / 12};
    Jet3d jet;
    jet.value = value(x);
    const auto at = [&](int i, int steps_i, int j, int steps_j) {
      Vec3d moved = x;
      moved[i] += steps_i * h;
      moved[j] += steps_j * h;
      return value(moved);
    };
    for (int i = 0; i < 3; ++i) {
      for (int s = -2; s <= 2; ++s) {
        const double sample = at(i, s, i, 0);
        jet.gradient[i] += first[static_cast<size_t>(s + 2)] * sample / h;
        jet.hessian(i, i) += second[static_cast<size_t>(s + 2)] * sample / (h * h);
      }
      for (int j = i + 1; j < 3; ++j) {
        for (int s = -2; s <= 2; ++s) {
          if (s == 0) continue;
          for (int t = -2; t <= 2; ++t) {
            if (t == 0) continue;
            jet.hessian(i, j) += first[static_cast<size_t>(s + 2)] * first[static_cast<size_t>(t + 2)] *
                                 at(i, s, j, t) / (h * h);
          }
        }
      }
    }
    return jet;
  }

  LevelRectangle light_;
  double light_z_;
  std::vector<Plate> plates_;
  double sigma_t_;
};

}  // namespace fogbank::derivatives::test
