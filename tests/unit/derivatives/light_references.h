// Mean radiance from single lights of radiance 1 in a homogeneous medium, by quadrature over exactly the part
// that is seen past a half-plane z = 1, y > edge.
#pragma once

#include <algorithm>
#include <functional>

#include "derivatives/quadrature.h"

namespace fogbank::derivatives::test {

/// The half-plane as seen from x (below it): points with `side` > 0 are visible. Infinite edge: no blocker.
struct HalfPlane {
  double edge = std::numeric_limits<double>::infinity();

  bool exists() const { return std::isfinite(edge); }
  /// side(y) = normal . (y - x)
  Vec3d normal(const Vec3d& x) const { return {0, -(1 - x.z), edge - x.y}; }
};

class LightReferences {
 public:
  LightReferences(double sigma_t, const HalfPlane& blocker) : sigma_t_(sigma_t), blocker_(blocker) {}

  /// Flat polygon: clipped, and its triangles integrated by Duffy's map. Corners counter-clockwise seen from
  /// the emitting side.
  double polygon(std::vector<Vec3d> corners, const Vec3d& x) const {
    const Vec3d normal = glm::normalize(glm::cross(corners[1] - corners[0], corners[2] - corners[0]));
    if (!(glm::dot(x - corners[0], normal) > 0)) return 0;
    if (blocker_.exists()) corners = clip(corners, x);
    double sum = 0;
    for (size_t i = 2; i < corners.size(); ++i) {
      const Vec3d a = corners[0];
      const Vec3d b = corners[i - 1] - a;
      const Vec3d c = corners[i] - a;
      const double area = glm::length(glm::cross(b, c));
      sum += area * integrate(nodes_, 0, 1, [&](double u) {
               return u * integrate(nodes_, 0, 1, [&](double v) {
                        return kernel(a + b * (u * (1 - v)) + c * (u * v), normal, x);
                      });
             });
    }
    return sum / (4 * std::numbers::pi);
  }

  /// Level disk around `center` that shines down.
  double disk(const Vec3d& center, double radius, const Vec3d& x) const {
    double last = std::numbers::pi / 2;
    if (blocker_.exists()) {
      const Vec3d n = blocker_.normal(x);
      const double y = x.y - n.z * (center.z - x.z) / n.y;  // where the half-plane's edge is seen
      last = std::asin(std::clamp((y - center.y) / radius, -1.0, 1.0));
    }
    const double sum = integrate(nodes_, -std::numbers::pi / 2, last, [&](double t) {
      const double half = radius * std::cos(t);
      return half * integrate(nodes_, -half, half, [&](double across) {
               return kernel(center + Vec3d(across, radius * std::sin(t), 0), Vec3d(0, 0, -1), x);
             });
    });
    return sum / (4 * std::numbers::pi);
  }

  /// By directions around the axis to the centre: the distance depends on the angle alone. R sin t = D sin
  /// theta makes it smooth up to the rim.
  double sphere(const Vec3d& center, double radius, const Vec3d& x) const {
    const double distance = glm::length(center - x);
    const Vec3d axis = (center - x) / distance;
    double mu = 1;
    double nu = 0;
    if (blocker_.exists()) {
      const Vec3d n = glm::normalize(blocker_.normal(x));
      mu = glm::dot(n, axis);
      nu = std::sqrt(1 - mu * mu);
    }
    const auto ring = [&](double t) {
      const double sine = radius * std::sin(t) / distance;
      const double cosine = std::sqrt(1 - sine * sine);
      const double k = nu > 0 && sine > 0 ? -mu * cosine / (nu * sine) : (mu > 0 ? -1 : 1);
      const double azimuths = 2 * std::acos(std::clamp(k, -1.0, 1.0));
      const double length = distance * cosine - radius * std::cos(t);
      return sine * azimuths * std::exp(-sigma_t_ * length) * radius * std::cos(t) / (distance * cosine);
    };
    // Rings beyond t0 are cut: an inverse cosine that starts like a square root.
    const double sine_0 = blocker_.exists() ? std::min(std::fabs(mu) * distance / radius, 1.0) : 1;
    const double t0 = std::asin(sine_0);
    const double whole = integrate(nodes_, 0, t0, ring);
    const double rest = std::numbers::pi / 2 - t0;
    const double cut =
        integrate(nodes_, 0, 1, [&](double s) { return ring(t0 + rest * s * s) * 2 * rest * s; });
    return (whole + cut) / (4 * std::numbers::pi);
  }

  /// Open cylinder along x from -half_length to half_length around (y, z) = (0, height).
  double cylinder(double half_length, double height, double radius, const Vec3d& x) const {
    const double dy = x.y;
    const double dz = x.z - height;
    const double distance = std::sqrt(dy * dy + dz * dz);
    const double middle = std::atan2(dz, dy);
    const double half = std::acos(radius / distance);
    double lower = middle - half;
    double upper = middle + half;
    if (blocker_.exists()) {
      // side = n.y (radius cos a - dy) + n.z (radius sin a - dz) > 0
      const Vec3d n = blocker_.normal(x);
      const double amplitude = radius * std::sqrt(n.y * n.y + n.z * n.z);
      const double offset = n.y * dy + n.z * dz;
      const double center = std::atan2(n.z, n.y);
      const double wide = std::acos(std::clamp(offset / amplitude, -1.0, 1.0));
      const double shift = std::round((middle - center) / (2 * std::numbers::pi)) * 2 * std::numbers::pi;
      lower = std::max(lower, center + shift - wide);
      upper = std::min(upper, center + shift + wide);
      if (!(lower < upper)) return 0;
    }
    const double sum = integrate(nodes_, lower, upper, [&](double angle) {
      const Vec3d normal(0, std::cos(angle), std::sin(angle));
      return integrate(nodes_, -half_length, half_length, [&](double along) {
        return kernel(Vec3d(along, 0, height) + normal * radius, normal, x);
      });
    });
    return radius * sum / (4 * std::numbers::pi);
  }

 private:
  double kernel(const Vec3d& y, const Vec3d& normal, const Vec3d& x) const {
    const Vec3d r = y - x;
    const double squared = glm::dot(r, r);
    const double distance = std::sqrt(squared);
    return -glm::dot(r, normal) / (squared * distance) * std::exp(-sigma_t_ * distance);
  }

  /// Sutherland and Hodgman.
  std::vector<Vec3d> clip(const std::vector<Vec3d>& corners, const Vec3d& x) const {
    const Vec3d n = blocker_.normal(x);
    std::vector<Vec3d> result;
    for (size_t i = 0; i < corners.size(); ++i) {
      const Vec3d& a = corners[i];
      const Vec3d& b = corners[(i + 1) % corners.size()];
      const double side_a = glm::dot(n, a - x);
      const double side_b = glm::dot(n, b - x);
      if (side_a > 0) result.push_back(a);
      if ((side_a > 0) != (side_b > 0)) result.push_back(a + (b - a) * (side_a / (side_a - side_b)));
    }
    return result;
  }

  double sigma_t_;
  HalfPlane blocker_;
  std::vector<std::array<double, 2>> nodes_ = gauss_legendre(32);
};

}  // namespace fogbank::derivatives::test
