#include "cache/metric.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <string>

#include "core/error.h"
#include "core/frame.h"

namespace fogbank::cache {
namespace {

/// C of the error integral C * product(a) * sum(|lambda| a^2): pi/8 in the plane, 2 pi/15 in space.
template <int Dim>
constexpr double integral_constant = Dim == 2 ? 3.14159265358979323846 / 8 : 2 * 3.14159265358979323846 / 15;

[[noreturn]] void refuse(const std::string& field, const std::string& range) {
  throw Error(ErrorKind::invalid_argument, "INVALID_SETTINGS", "metric: " + field + " must be " + range);
}

bool positive(double value) { return std::isfinite(value) && value > 0; }
bool not_negative(double value) { return std::isfinite(value) && value >= 0; }

}  // namespace

void validate(const MetricSettings& settings) {
  if (!positive(settings.threshold)) refuse("threshold", "positive");
  if (!positive(settings.first_order_change)) refuse("first_order_change", "positive");
  if (!positive(settings.radiance_floor)) refuse("radiance_floor", "positive");
  if (!positive(settings.direct_floor)) refuse("direct_floor", "positive");
  if (!(settings.maximum_anisotropy >= 1 && settings.maximum_anisotropy <= 1e4))
    refuse("maximum_anisotropy", "between 1 and 10000");
  if (!positive(settings.maximum_radius)) refuse("maximum_radius", "positive");
  if (!not_negative(settings.minimum_radius)) refuse("minimum_radius", "finite and not negative");
  if (!not_negative(settings.minimum_pixels)) refuse("minimum_pixels", "finite and not negative");
  for (const PixelFootprint& footprint : settings.footprints) {
    if (!is_finite(footprint.camera)) refuse("footprints.camera", "finite");
    if (!not_negative(static_cast<double>(footprint.pixel_angle)))
      refuse("footprints.pixel_angle", "finite and not negative");
  }
}

template <int Dim>
double error_integral(const std::array<double, static_cast<size_t>(Dim)>& eigenvalues,
                      const std::array<double, static_cast<size_t>(Dim)>& semi_axes) {
  double volume = 1;
  double sum = 0;
  for (size_t i = 0; i < eigenvalues.size(); ++i) {
    volume *= semi_axes[i];
    sum += std::fabs(eigenvalues[i]) * semi_axes[i] * semi_axes[i];
  }
  return integral_constant<Dim> * volume * sum;
}

template <int Dim>
double ball_radius(const std::array<double, static_cast<size_t>(Dim)>& eigenvalues, double budget) {
  double sum = 0;
  for (const double eigenvalue : eigenvalues) sum += std::fabs(eigenvalue);
  return std::pow(budget / (integral_constant<Dim> * sum), 1.0 / (Dim + 2));
}

template <int Dim>
std::array<double, static_cast<size_t>(Dim)> level_set_semi_axes(
    const std::array<double, static_cast<size_t>(Dim)>& eigenvalues, double budget,
    const std::array<double, static_cast<size_t>(Dim)>& caps, double maximum_anisotropy) {
  using Axes = std::array<double, static_cast<size_t>(Dim)>;
  double largest = 0;
  for (const double eigenvalue : eigenvalues) largest = std::max(largest, std::fabs(eigenvalue));
  Axes lambda{};
  for (size_t i = 0; i < lambda.size(); ++i)
    lambda[i] = std::max(std::fabs(eigenvalues[i]), largest / (maximum_anisotropy * maximum_anisotropy));
  if (error_integral<Dim>(lambda, caps) <= budget) return caps;

  // Beyond here lambda > 0. Without caps the integral is C Dim k^(Dim/2 + 1) / sqrt(product of lambda).
  double log_product = 0;
  double upper = -std::numeric_limits<double>::infinity();
  for (size_t i = 0; i < lambda.size(); ++i) {
    log_product += std::log(lambda[i]);
    upper = std::max(upper, std::log(lambda[i]) + 2 * std::log(caps[i]));
  }
  double lower = (std::log(budget / (integral_constant<Dim> * Dim)) + log_product / 2) * 2 / (Dim + 2);
  const auto axes_at = [&](double log_k) {
    Axes axes{};
    for (size_t i = 0; i < axes.size(); ++i)
      axes[i] = std::min(std::exp(log_k / 2) / std::sqrt(lambda[i]), caps[i]);
    return axes;
  };
  // Caps only lower the integral, so the k without caps is too small at most. Newton steps on log(integral)
  // against log k, whose slope is at least 1/2 until all caps bind, inside a bracket.
  double log_k = lower;
  for (int step = 0; step < 60; ++step) {
    const Axes axes = axes_at(log_k);
    const double excess = std::log(error_integral<Dim>(lambda, axes) / budget);
    if (std::fabs(excess) < 1e-14) break;
    (excess < 0 ? lower : upper) = log_k;
    double sum = 0;
    double free_sum = 0;
    double slope = 0;
    for (size_t i = 0; i < axes.size(); ++i) {
      const double term = lambda[i] * axes[i] * axes[i];
      sum += term;
      if (axes[i] < caps[i]) {
        free_sum += term;
        slope += 0.5;
      }
    }
    slope += free_sum / sum;
    const double next = slope > 0 ? log_k - excess / slope : upper;
    const double previous = log_k;
    log_k = next > lower && next < upper ? next : (lower + upper) / 2;
    if (log_k == previous) break;
  }
  return axes_at(log_k);
}

Ellipsoid Ellipsoid::clamped(float scale, float greatest, float least) const {
  Ellipsoid result = *this;
  for (float& a : result.semi_axes) a = std::max(std::min(a * scale, greatest), least);
  return result;
}

float Ellipsoid::longest() const { return std::max({semi_axes[0], semi_axes[1], semi_axes[2]}); }

float Ellipsoid::shortest() const { return std::min({semi_axes[0], semi_axes[1], semi_axes[2]}); }

Ellipsoid Ellipsoid::flat() const {
  Ellipsoid result = *this;
  result.semi_axes[2] = surface_thickness * std::min(semi_axes[0], semi_axes[1]);
  return result;
}

Vec3d Ellipsoid::half_extents() const {
  Vec3d sum(0);
  for (size_t k = 0; k < 3; ++k) {
    const Vec3d semi_axis = static_cast<double>(semi_axes[k]) * Vec3d(axes[k]);
    sum += semi_axis * semi_axis;
  }
  return glm::sqrt(sum);
}

Symmetric3d Ellipsoid::inverse_root() const {
  Symmetric3d result;
  for (size_t k = 0; k < 3; ++k) {
    const double inverse =
        empty() ? std::numeric_limits<double>::quiet_NaN() : 1 / static_cast<double>(semi_axes[k]);
    result += inverse * Symmetric3d::outer(Vec3d(axes[k]));
  }
  return result;
}

double surface_threshold(const MetricSettings& settings) {
  return settings.threshold * 15 / (16 * 0.4 * settings.maximum_radius);
}

double reference_radiance(const MetricSettings& settings, double luminance) {
  return settings.reference == Reference::local ? std::max(luminance, settings.radiance_floor)
                                                : settings.radiance_floor;
}

float minimum_radius(const MetricSettings& settings, const Vec3f& position) {
  double pixels = std::numeric_limits<double>::infinity();
  for (const PixelFootprint& footprint : settings.footprints)
    pixels = std::min(pixels, glm::distance(Vec3d(footprint.camera), Vec3d(position)) *
                                  static_cast<double>(footprint.pixel_angle));
  if (settings.footprints.empty()) return static_cast<float>(settings.minimum_radius);
  return static_cast<float>(std::max(settings.minimum_radius, settings.minimum_pixels * pixels));
}

namespace {

Vec3d luminance_gradient(const Place& place) {
  Vec3d gradient(0);
  for (int axis = 0; axis < 3; ++axis)
    gradient[axis] = static_cast<double>(
        luminance({place.gradient[0][axis], place.gradient[1][axis], place.gradient[2][axis]}));
  return gradient;
}

/// Semi-axes along the eigenvectors of the Hessian, `gradient` in the same space.
template <int Dim>
std::array<double, static_cast<size_t>(Dim)> semi_axes_of(const MetricSettings& settings, const Place& place,
                                                          const Eigensystem<Dim>& system,
                                                          const glm::vec<Dim, double>& gradient) {
  const double level = static_cast<double>(luminance(place.radiance));
  const double threshold = Dim == 2 ? surface_threshold(settings) : settings.threshold;
  const double budget = threshold * reference_radiance(settings, level);
  double bound = settings.maximum_radius;
  if (settings.guards.visibility_margin)
    bound = std::min(bound, static_cast<double>(place.visibility_margin));
  // Steps longer than L / |g| would extrapolate below 0; what is dimmer than the floor may.
  const double positive_radiance = std::max(level, settings.radiance_floor);
  std::array<double, static_cast<size_t>(Dim)> semi_axes{};
  if (settings.shape == Shape::sphere) {
    bound = std::min(bound, positive_radiance / glm::length(gradient));
    semi_axes.fill(std::min(bound, ball_radius<Dim>(system.values, budget)));
    return semi_axes;
  }
  std::array<double, static_cast<size_t>(Dim)> caps{};
  for (size_t k = 0; k < caps.size(); ++k)
    caps[k] = std::min(bound, positive_radiance / std::fabs(glm::dot(gradient, system.vectors[k])));
  semi_axes = level_set_semi_axes<Dim>(system.values, budget, caps, settings.maximum_anisotropy);
  // Caps may differ by more than eigenvalues do.
  const double longest = settings.maximum_anisotropy * *std::min_element(semi_axes.begin(), semi_axes.end());
  for (double& a : semi_axes) a = std::min(a, longest);
  return semi_axes;
}

}  // namespace

float extrapolated(Quantity quantity, float radiance, float change) {
  constexpr float greatest_brightening = 4;
  if (!is_unaware(quantity)) return std::max(radiance + change, 0.0f);
  return radiance > 0 ? radiance * std::min(std::exp(change / radiance), greatest_brightening) : 0.0f;
}

Place as_radiance(Place place) {
  if (place.quantity != Quantity::ratio) return place;
  place.radiance *= place.proxy;
  for (Vec3f& gradient : place.gradient) gradient *= place.proxy;
  place.hessian *= place.proxy;
  place.variance *= place.proxy * place.proxy;
  return place;
}

Ellipsoid base_ellipsoid(const MetricSettings& settings, const Place& stored) {
  if (is_unaware(stored.quantity)) {
    Ellipsoid sphere{{Vec3f(1, 0, 0), Vec3f(0, 1, 0), Vec3f(0, 0, 1)}, {}};
    sphere.semi_axes.fill(static_cast<float>(
        std::min(settings.maximum_radius, settings.first_order_change * static_cast<double>(stored.proxy))));
    return sphere;
  }
  const Place place = as_radiance(stored);
  Symmetric3d hessian;
  for (size_t i = 0; i < hessian.entries.size(); ++i)
    hessian.entries[i] = static_cast<double>(place.hessian.entries[i]);
  const Vec3d gradient = luminance_gradient(place);
  Ellipsoid result;
  if (place.normal == Vec3f(0)) {
    const Eigensystem<3> system = eigen_decomposition(hessian);
    const std::array<double, 3> semi_axes = semi_axes_of<3>(settings, place, system, gradient);
    for (size_t k = 0; k < 3; ++k) {
      result.axes[k] = system.vectors[k];
      result.semi_axes[k] = static_cast<float>(semi_axes[k]);
    }
    return result;
  }
  const Frame frame = Frame::from_normal(place.normal);
  const std::array<Vec3d, 2> tangents{Vec3d(frame.tangent), Vec3d(frame.bitangent)};
  Symmetric<double, 2> tangential;
  for (int i = 0; i < 2; ++i)
    for (int j = i; j < 2; ++j)
      tangential(i, j) =
          glm::dot(tangents[static_cast<size_t>(i)], hessian * tangents[static_cast<size_t>(j)]);
  const Eigensystem<2> system = eigen_decomposition(tangential);
  const std::array<double, 2> semi_axes = semi_axes_of<2>(
      settings, place, system, {glm::dot(gradient, tangents[0]), glm::dot(gradient, tangents[1])});
  for (size_t k = 0; k < 2; ++k) {
    result.axes[k] = Vec3f(tangents[0] * system.vectors[k].x + tangents[1] * system.vectors[k].y);
    result.semi_axes[k] = static_cast<float>(semi_axes[k]);
  }
  result.axes[2] = place.normal;
  return result.flat();
}

template double error_integral<2>(const std::array<double, 2>&, const std::array<double, 2>&);
template double error_integral<3>(const std::array<double, 3>&, const std::array<double, 3>&);
template double ball_radius<2>(const std::array<double, 2>&, double);
template double ball_radius<3>(const std::array<double, 3>&, double);
template std::array<double, 2> level_set_semi_axes<2>(const std::array<double, 2>&, double,
                                                      const std::array<double, 2>&, double);
template std::array<double, 3> level_set_semi_axes<3>(const std::array<double, 3>&, double,
                                                      const std::array<double, 3>&, double);

}  // namespace fogbank::cache
