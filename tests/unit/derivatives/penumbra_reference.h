// The direct light of scenes/penumbra without rays, grids or form factors: what the two plates leave of the
// ceiling light is a sum of rectangles, each integrated by Gauss-Legendre quadrature.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <vector>

#include "derivatives/quadrature.h"

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
    return differentiate([&](const Vec3d& at) { return value(at); }, x, h);
  }

  LevelRectangle light_;
  double light_z_;
  std::vector<Plate> plates_;
  double sigma_t_;
};

}  // namespace fogbank::derivatives::test
