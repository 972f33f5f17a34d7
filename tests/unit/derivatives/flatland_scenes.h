// Scenes and measures that the flatland tests share.
#pragma once

#include <algorithm>
#include <cmath>
#include <numbers>
#include <string>
#include <vector>

#include "derivatives/flatland/direct_radiance.h"
#include "derivatives/flatland/field_functions.h"
#include "derivatives/flatland/model.h"

namespace fogbank::derivatives::flatland {

/// The box of method.md section 16; for multiple scattering sigma_t = 2, albedo = 0.8, as its experiments
/// have it.
inline SceneDescription box_scene(double sigma_t = 1, double albedo = 1) {
  SceneDescription scene;
  scene.sigma_t = sigma_t;
  scene.albedo = albedo;
  scene.segments = {{{0.3, 0.95}, {0.7, 0.95}, 1}, {{0.1, 0.55}, {0.5, 0.55}, 0}};
  return scene;
}

/// Two lights of different radiance, one of them slanted, and two slanted occluders that cross.
inline SceneDescription crowded_scene() {
  SceneDescription scene;
  scene.box_min = {-1, -0.5};
  scene.box_max = {1.5, 1};
  scene.sigma_t = 0.7;
  scene.albedo = 0.9;
  scene.segments = {{{-0.8, 0.5}, {-0.4, 0.9}, 2},
                    {{0.7, 0.9}, {1.2, 0.9}, 0.5},
                    {{-0.2, 0.1}, {0.4, 0.4}, 0},
                    {{0.0, 0.45}, {0.2, 0.05}, 0}};
  return scene;
}

enum class Zone { lit, penumbra, umbra };

/// By the share of the first segment, the light, that is visible.
inline Zone zone_of(const SceneDescription& description, const Vec2d& x) {
  SceneDescription clear = description;
  clear.sigma_t = 0;
  const double seen = direct_radiance<double>(Scene(clear), x);
  clear.segments.resize(1);
  const double whole = direct_radiance<double>(Scene(clear), x);
  if (seen <= 1e-12 * whole) return Zone::umbra;
  return seen < whole * (1 - 1e-12) ? Zone::penumbra : Zone::lit;
}

/// Points of an n x n grid of the unit box, away from the light, from the occluder's height and from zone
/// boundaries, where there is no derivative.
inline std::vector<Vec2d> box_points(Zone zone, int n) {
  const SceneDescription scene = box_scene();
  std::vector<Vec2d> points;
  for (int row = 0; row < n; ++row) {
    for (int column = 0; column < n; ++column) {
      const Vec2d x(0.02 + 0.96 * (column + 0.5) / n, 0.02 + 0.96 * (row + 0.5) / n);
      if (std::abs(x.y - 0.55) < 0.02 || x.y > 0.92 || zone_of(scene, x) != zone) continue;
      constexpr double step = 4e-4;
      const bool inside =
          zone_of(scene, x + Vec2d(step, 0)) == zone && zone_of(scene, x - Vec2d(step, 0)) == zone &&
          zone_of(scene, x + Vec2d(0, step)) == zone && zone_of(scene, x - Vec2d(0, step)) == zone;
      if (inside) points.push_back(x);
    }
  }
  return points;
}

/// Errors over points, relative to the sum of what is estimated.
struct Errors {
  double median_angle = 0;  ///< degrees between the gradients
  double gradient = 0;
  double hessian = 0;
  double value = 0;  ///< bias
};

/// `estimate` and `reference` map a point to a jet.
template <typename Estimator, typename Reference>
Errors measure(const std::vector<Vec2d>& points, const Estimator& estimate, const Reference& reference) {
  Errors errors;
  double values = 0;
  double gradients = 0;
  double hessians = 0;
  std::vector<double> angles;
  for (const Vec2d& x : points) {
    const Jet2d found = estimate(x);
    const Jet2d truth = reference(x);
    errors.value += found.value - truth.value;
    errors.gradient += glm::length(found.gradient - truth.gradient);
    errors.hessian += (found.hessian - truth.hessian).norm();
    values += truth.value;
    gradients += glm::length(truth.gradient);
    hessians += truth.hessian.norm();
    const double lengths = glm::length(found.gradient) * glm::length(truth.gradient);
    if (lengths > 0) {
      const double cosine = glm::dot(found.gradient, truth.gradient) / lengths;
      angles.push_back(std::acos(std::clamp(cosine, -1.0, 1.0)) * 180 / std::numbers::pi);
    }
  }
  errors.value /= values;
  errors.gradient /= gradients;
  errors.hessian /= hessians;
  std::nth_element(angles.begin(), angles.begin() + static_cast<std::ptrdiff_t>(angles.size() / 2),
                   angles.end());
  errors.median_angle = angles[angles.size() / 2];
  return errors;
}

/// All corrections off: the scheme of the talk.
inline Settings plain_settings(Order order, int32_t samples) {
  Settings settings;
  settings.order = order;
  settings.samples = samples;
  settings.bisections = 0;
  settings.mean_rule = settings.sliding = settings.subtract = settings.obliquity = false;
  return settings;
}

/// Fourth-order central differences of `field`.
template <typename Field>
Jet2d finite_differences(const Field& field, const Vec2d& x, double step) {
  const auto at = [&](double a, double b) { return field(x + step * Vec2d(a, b)); };
  Jet2d jet = Jet2d::constant(at(0, 0));
  for (int axis = 0; axis < 2; ++axis) {
    const auto along = [&](double a) { return axis == 0 ? at(a, 0) : at(0, a); };
    jet.gradient[axis] = (8 * (along(1) - along(-1)) - (along(2) - along(-2))) / (12 * step);
    jet.hessian(axis, axis) =
        (16 * (along(1) + along(-1)) - (along(2) + along(-2)) - 30 * jet.value) / (12 * step * step);
  }
  const auto mixed = [&](double a) { return (at(a, a) - at(a, -a) - at(-a, a) + at(-a, -a)) / (4 * a * a); };
  jet.hessian(0, 1) = (4 * mixed(1) - mixed(2)) / (3 * step * step);
  return jet;
}

}  // namespace fogbank::derivatives::flatland
