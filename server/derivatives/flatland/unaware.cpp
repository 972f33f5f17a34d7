#include "derivatives/flatland/unaware.h"

#include <algorithm>

#include "derivatives/flatland/ring.h"
#include "derivatives/transmittance_jet.h"

namespace fogbank::derivatives::flatland {

namespace {

using Matrix = Symmetric<double, 2>;

/// K and its derivatives from those of log K, for K = `value` here.
Jet2d from_logarithm(double value, const Vec2d& gradient, const Matrix& hessian) {
  return {value, value * gradient, value * (hessian + Matrix::outer(gradient))};
}

void add(Estimate& estimate, const Jet2d& sample) {
  estimate.mean += sample;
  estimate.gradient_magnitude += glm::length(sample.gradient);
}

}  // namespace

Estimate estimate_surfaces_unaware(const Scene& scene, const Settings& settings, const Vec2d& x) {
  const Ring ring = make_ring(scene, x, settings.samples, 0, settings.seed);
  const double sigma_t = scene.sigma_t();
  Estimate estimate;
  for (const Sight& sight : ring.sights) {
    const double radiance = scene.radiance(sight.hit.surface);
    if (radiance == 0) continue;
    // K = T (n . r) / l^2
    const double l = sight.hit.distance;
    const Vec2d& u = sight.direction;
    const Vec2d& n = scene.line(sight.hit.surface).normal;
    const Vec2d n_over_nr = n / (l * glm::dot(n, u));
    const Matrix along = Matrix::outer(u);
    const Matrix across = Matrix::identity() - along;
    add(estimate,
        from_logarithm(
            radiance * transmittance(sigma_t, l) / settings.samples, (sigma_t + 2 / l) * u - n_over_nr,
            across * (-sigma_t / l) + (across - along) * (-2 / (l * l)) - Matrix::outer(n_over_nr)));
  }
  estimate.stratified_mean = estimate.mean.value;
  estimate.rays = ring.rays;
  return estimate;
}

Estimate estimate_medium_unaware(const Scene& scene, const Source& source, const Settings& settings,
                                 const Vec2d& x) {
  const Ring ring = make_ring(scene, x, settings.samples, 0, settings.seed);
  const double sigma_t = scene.sigma_t();
  const double weight = scene.sigma_s() * settings.march_step / settings.samples;
  Estimate estimate;
  for (const Sight& sight : ring.sights) {
    const Vec2d& u = sight.direction;
    const Matrix along = Matrix::outer(u);
    const Matrix across = Matrix::identity() - along;
    const double end = std::min(sight.hit.distance, scene.reach());
    for (int k = 0; (k + 0.5) * settings.march_step < end; ++k) {
      const double s = (k + 0.5) * settings.march_step;
      // K = T / s
      add(estimate,
          from_logarithm(weight * transmittance(sigma_t, s) * source.value(x + s * u), (sigma_t + 1 / s) * u,
                         across * (-sigma_t / s) + (across - along) * (-1 / (s * s))));
    }
  }
  estimate.stratified_mean = estimate.mean.value;
  estimate.rays = ring.rays;
  return estimate;
}

}  // namespace fogbank::derivatives::flatland
