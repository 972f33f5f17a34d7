#include "derivatives/flatland/aware.h"
#include "derivatives/flatland/ring_segments.h"
#include "derivatives/transmittance_jet.h"

namespace fogbank::derivatives::flatland {

namespace {

/// The sum of one light's segments and the stratified mean of its rays.
struct LightSum {
  Jet2d triangulated;
  double stratified = 0;
};

class SurfaceSum {
 public:
  SurfaceSum(const Scene& scene, const Settings& settings)
      : scene_(scene), settings_(settings), lights_(scene.segments().size()) {}

  void add_stratified(const Sight& sight) {
    if (const double radiance = scene_.radiance(sight.hit.surface); radiance > 0) {
      light(sight).stratified +=
          radiance * transmittance(scene_.sigma_t(), sight.hit.distance) / settings_.samples;
    }
  }

  void add_segment(const Sight& from, const Sight& to) {
    if (from.hit.surface == to.hit.surface && settings_.mean_rule) {
      const double radiance = scene_.radiance(from.hit.surface);
      if (radiance > 0) {
        const Jet2d mean = (transmittance_at(from) + transmittance_at(to)) * 0.5;
        light(from).triangulated += mean * form_factor(from.offset(), to.offset()) * radiance;
      }
      return;
    }
    const bool forward = to.hit.distance > from.hit.distance;
    const Sight& far = forward ? to : from;
    const double radiance = scene_.radiance(far.hit.surface);
    if (radiance == 0) return;
    const Jet2d factor = form_factor(from.offset(), to.offset());
    const Jet2d far_transmittance = transmittance_at(far);
    light(far).triangulated += far_transmittance * factor * radiance;
    if (settings_.sliding && from.hit.surface != to.hit.surface) {
      const double slope = -scene_.sigma_t() * radiance * far_transmittance.value *
                           distance_slope(far.hit, far.direction, scene_.line(far.hit.surface));
      light(far).triangulated += sliding_term(forward ? slope : -slope, factor);
    }
  }

  Estimate result(uint64_t rays) const {
    Estimate estimate;
    estimate.rays = rays;
    for (const LightSum& sum : lights_) {
      Jet2d jet = sum.triangulated;
      if (settings_.ratio && sum.triangulated.value > 0) {
        const double ratio = sum.stratified / sum.triangulated.value;
        jet.gradient *= ratio;
        jet.hessian *= ratio;
      }
      estimate.mean += jet;
      estimate.stratified_mean += sum.stratified;
    }
    return estimate;
  }

 private:
  LightSum& light(const Sight& sight) { return lights_[static_cast<size_t>(sight.hit.surface)]; }
  Jet2d transmittance_at(const Sight& sight) const {
    return transmittance_jet(scene_.sigma_t(), distance_jet<double, 2>(sight.offset()));
  }

  const Scene& scene_;
  const Settings& settings_;
  std::vector<LightSum> lights_;
};

}  // namespace

Estimate estimate_surfaces_aware(const Scene& scene, const Settings& settings, const Vec2d& x) {
  const Ring ring = make_ring(scene, x, settings.samples, settings.bisections, settings.seed);
  SurfaceSum sum(scene, settings);
  for (size_t i = 0; i < ring.sights.size(); ++i) {
    if (ring.sights[i].stratified) sum.add_stratified(ring.sights[i]);
    sum.add_segment(ring.sights[i], ring.after(i));
  }
  return sum.result(ring.rays);
}

}  // namespace fogbank::derivatives::flatland
