#include <algorithm>
#include <numbers>
#include <vector>

#include "derivatives/flatland/aware.h"
#include "derivatives/flatland/ring_segments.h"
#include "derivatives/transmittance_jet.h"

namespace fogbank::derivatives::flatland {

namespace {

using Matrix = Symmetric<double, 2>;

/// Sums over a ray's first shells (method.md section 8.4).
struct Moments {
  double m0 = 0;
  double m1 = 0;  ///< with 1/s
  double m2 = 0;  ///< with 1/s^2
};

class MediumSum {
 public:
  MediumSum(const Scene& scene, const Source& source, const Settings& settings, const Vec2d& x, Ring ring)
      : scene_(scene),
        source_(source),
        settings_(settings),
        x_(x),
        ring_(std::move(ring)),
        constant_(settings.subtract ? source.value(x) : 0) {
    marches_.reserve(ring_.sights.size());
    for (const Sight& sight : ring_.sights) march(sight);
  }

  Estimate result() {
    for (size_t i = 0; i < ring_.sights.size(); ++i) {
      const size_t j = i + 1 < ring_.sights.size() ? i + 1 : 0;
      if (constant_ != 0) add_constant(ring_.sights[i], ring_.sights[j]);
      if (settings_.sliding && ring_.sights[i].hit.surface != ring_.sights[j].hit.surface)
        add_sliding_end(ring_.sights[i], ring_.sights[j]);
      const size_t common = std::min(marches_[i].size(), marches_[j].size());
      add_common_shells(i, j, common);
      if (marches_[i].size() > common) add_slanted_shells(i, j, common, false);
      if (marches_[j].size() > common) add_slanted_shells(j, i, common, true);
    }
    estimate_.rays = ring_.rays;
    return estimate_;
  }

 private:
  double distance(size_t shell) const { return (static_cast<double>(shell) + 0.5) * settings_.march_step; }

  void march(const Sight& sight) {
    std::vector<double>& march = marches_.emplace_back();
    const double end = std::min(sight.hit.distance, scene_.reach());
    for (size_t k = 0; distance(k) < end; ++k) {
      const double weight =
          scene_.sigma_s() * settings_.march_step * transmittance(scene_.sigma_t(), distance(k));
      const double q = source_.value(x_ + sight.direction * distance(k));
      march.push_back(weight * (q - constant_));
      if (sight.stratified) estimate_.stratified_mean += weight * q / settings_.samples;
    }
  }

  /// The constant part of the source: sigma_s q0 int T ds up to the surface, in closed form (section 8.3).
  void add_constant(const Sight& from, const Sight& to) {
    const double weight = scene_.sigma_s() * constant_;
    const Jet2d factor = form_factor(from.offset(), to.offset());
    const auto length_at = [this](const Sight& sight) {
      return transmittance_integral_jet(scene_.sigma_t(), distance_jet<double, 2>(sight.offset()));
    };
    if (from.hit.surface == to.hit.surface && settings_.mean_rule) {
      estimate_.mean += (length_at(from) + length_at(to)) * factor * (0.5 * weight);
      return;
    }
    const bool forward = to.hit.distance > from.hit.distance;
    const Sight& far = forward ? to : from;
    estimate_.mean += length_at(far) * factor * weight;
  }

  /// The far end of a gap between surfaces slides, and with it the length of the rays that pass there: the
  /// silhouettes' term of what is marched there, the constant part included.
  void add_sliding_end(const Sight& from, const Sight& to) {
    const bool forward = to.hit.distance > from.hit.distance;
    const Sight& far = forward ? to : from;
    // Just in front of the surface: on a light's own line its light is missing.
    const double q = source_.value(x_ + far.direction * (far.hit.distance * (1 - 1e-6)));
    const double slope = scene_.sigma_s() * q * transmittance(scene_.sigma_t(), far.hit.distance) *
                         distance_slope(far.hit, far.direction, scene_.line(far.hit.surface));
    estimate_.mean += sliding_term(forward ? slope : -slope, form_factor(from.offset(), to.offset()));
  }

  /// Shells that both rays reach: scaled copies of the unit shell, so that moments do (section 8.4).
  void add_common_shells(size_t i, size_t j, size_t count) {
    if (count == 0) return;
    const Jet2d unit = form_factor(ring_.sights[i].direction, ring_.sights[j].direction);
    for (const size_t end : {i, j}) {
      Moments moments;
      for (size_t k = 0; k < count; ++k) {
        const double light = marches_[end][k] / 2;
        const double closeness = 1 / distance(k);
        moments.m0 += light;
        moments.m1 += light * closeness;
        moments.m2 += light * closeness * closeness;
      }
      const Vec2d& u = ring_.sights[end].direction;
      const Matrix along = Matrix::outer(u);
      const Matrix across = Matrix::identity() - along;
      const double sigma_t = scene_.sigma_t();
      Jet2d sum;
      sum.value = moments.m0 * unit.value;
      sum.gradient = sigma_t * moments.m0 * unit.value * u + moments.m1 * unit.gradient;
      sum.hessian = unit.value * (sigma_t * sigma_t * moments.m0 * along - sigma_t * moments.m1 * across) +
                    sigma_t * moments.m1 * Matrix::outer_sum(u, unit.gradient) + moments.m2 * unit.hessian;
      if (settings_.obliquity) sum.hessian += moments.m2 * unit.value * across;
      estimate_.mean += sum;
    }
  }

  /// Shells beyond the end of the nearer ray: segments from its hit to the farther ray. `forward`: the
  /// farther one comes after the nearer.
  void add_slanted_shells(size_t far, size_t near, size_t first, bool forward) {
    const Sight& sight = ring_.sights[far];
    const Vec2d blocked = ring_.sights[near].offset();
    for (size_t k = first; k < marches_[far].size(); ++k) {
      const Vec2d shell = sight.direction * distance(k);
      const Jet2d factor = forward ? form_factor(blocked, shell) : form_factor(shell, blocked);
      const double light = marches_[far][k];
      // As a function of x the shell's light varies by its transmittance only.
      const double transmittance_here = transmittance(scene_.sigma_t(), distance(k));
      if (transmittance_here == 0) break;
      estimate_.mean += transmittance_jet(scene_.sigma_t(), distance_jet<double, 2>(shell)) * factor *
                        (light / transmittance_here);
      if (settings_.sliding) estimate_.mean += sliding_term(angular_slope(far, k, forward), factor);
    }
  }

  /// Derivative of a shell's light by angle at a silhouette, into the lit side: from the next ray, if it gets
  /// as far.
  double angular_slope(size_t sight, size_t shell, bool forward) const {
    const size_t count = ring_.sights.size();
    const size_t next = forward ? (sight + 1) % count : (sight + count - 1) % count;
    if (marches_[next].size() <= shell) return 0;
    double gap = forward ? ring_.sights[next].angle - ring_.sights[sight].angle
                         : ring_.sights[sight].angle - ring_.sights[next].angle;
    if (gap < 0) gap += 2 * std::numbers::pi;
    return gap > 0 ? (marches_[next][shell] - marches_[sight][shell]) / gap : 0;
  }

  const Scene& scene_;
  const Source& source_;
  const Settings& settings_;
  Vec2d x_;
  Ring ring_;
  double constant_;
  /// By ray: sigma_s (q - q0) T ds of each shell before the hit, at s_k = (k + 1/2) ds.
  std::vector<std::vector<double>> marches_;
  Estimate estimate_;
};

}  // namespace

Estimate estimate_medium_aware(const Scene& scene, const Source& source, const Settings& settings,
                               const Vec2d& x) {
  return MediumSum(scene, source, settings, x,
                   make_ring(scene, x, settings.samples, settings.bisections, settings.seed))
      .result();
}

}  // namespace fogbank::derivatives::flatland
