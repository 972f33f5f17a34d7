#include "cache/flatland/ellipse.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <string>

#include "cache/eigen.h"
#include "core/error.h"

namespace fogbank::cache::flatland {

namespace {

/// Most that extrapolation of the logarithm may brighten: below the minimum radius nothing else bounds it.
constexpr double greatest_brightening = 4;

[[noreturn]] void refuse(const std::string& field, const std::string& range) {
  throw Error(ErrorKind::invalid_argument, "INVALID_SETTINGS", field + ": must be " + range);
}

Ellipse circle(double radius) { return {Vec2d(1, 0), {radius, radius}}; }

Ellipse second_order_ellipse(const Settings& settings, double radiance, const Record& record, double bound) {
  const Eigensystem<2> system = eigen_decomposition(record.mean.hessian);
  const Vec2d& gradient = record.mean.gradient;
  const double budget = settings.threshold * radiance;
  if (settings.shape == Shape::sphere) {
    return circle(std::min({bound, radiance / glm::length(gradient), ball_radius<2>(system.values, budget)}));
  }
  std::array<double, 2> caps{};
  for (size_t k = 0; k < 2; ++k)
    caps[k] = std::min(bound, radiance / std::fabs(glm::dot(gradient, system.vectors[k])));
  Ellipse result{system.vectors[0],
                 level_set_semi_axes<2>(system.values, budget, caps, settings.maximum_anisotropy)};
  // Caps may differ by more than eigenvalues do.
  const double longest = settings.maximum_anisotropy * std::min(result.semi_axes[0], result.semi_axes[1]);
  for (double& a : result.semi_axes) a = std::min(a, longest);
  return result;
}

}  // namespace

void validate(const Settings& settings) {
  const auto positive = [](double value) { return std::isfinite(value) && value > 0; };
  if (!positive(settings.threshold)) refuse("threshold", "positive");
  if (!(settings.maximum_anisotropy >= 1 && settings.maximum_anisotropy <= 1e4))
    refuse("maximum_anisotropy", "1 to 10000");
  if (!positive(settings.maximum_radius)) refuse("maximum_radius", "positive");
  if (!positive(settings.minimum_radius)) refuse("minimum_radius", "positive");
}

Ellipse Ellipse::clamped(double scale, double greatest, double least) const {
  Ellipse result = *this;
  for (double& a : result.semi_axes) a = std::max(std::min(a * scale, greatest), least);
  return result;
}

Ellipse base_ellipse(const Settings& settings, double radiance_floor, const Record& record) {
  double bound = settings.maximum_radius;
  if (settings.guards.visibility_margin) bound = std::min(bound, record.surroundings.visibility_margin);
  const Ellipse ellipse =
      settings.metric == Metric::first_order
          ? circle(std::min(bound, settings.threshold * record.change_length))
          : second_order_ellipse(settings, std::max(record.mean.value, radiance_floor), record, bound);
  return ellipse.clamped(1, settings.maximum_radius, settings.minimum_radius);
}

double verify_tolerance(const Settings& settings, const Ellipse& ellipse) {
  const double border =
      settings.metric == Metric::first_order
          ? settings.threshold
          : 4 * settings.threshold / (std::numbers::pi * ellipse.semi_axes[0] * ellipse.semi_axes[1]);
  return std::max(border, 0.005);
}

double extrapolated(const Settings& settings, const Record& record, const Vec2d& offset) {
  const double mean = record.mean.value;
  const double change = glm::dot(record.mean.gradient, offset);
  if (settings.metric == Metric::second_order) return std::max(0.0, mean + change);
  return mean > 0 ? mean * std::min(std::exp(change / mean), greatest_brightening) : 0;
}

}  // namespace fogbank::cache::flatland
