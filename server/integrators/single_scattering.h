// Light that is scattered exactly once between an emitter and a segment's origin: the part of a picture that
// has techniques of its own (ratio-records.md). Per light: sampled by its closed-form unoccluded proxy, or
// that proxy times the cached share of it that arrives.
#pragma once

#include <memory>
#include <span>
#include <vector>

#include "cache/index.h"
#include "integrators/look_up_observer.h"
#include "integrators/single_scattering_plan.h"
#include "transport/bundle_points.h"
#include "transport/medium_segment.h"
#include "transport/shadow_map.h"
#include "transport/world.h"

namespace fogbank::integrators {

/// How a segment's light is wanted.
struct SegmentUse {
  bool seen = true;          ///< by the camera, straight or by mirrors and glass: worth more rays
  bool wants_cached = true;  ///< PixelSample::cached; without, it is 0 for less time
};

/// One instance serves all threads; changed by `decide` alone.
class SingleScatteringTerm {
 public:
  explicit SingleScatteringTerm(std::shared_ptr<const transport::World> world);

  /// Settles, once, which lights are looked up, by the settings or by predicted cost. `there`: ratios that
  /// there are. While nothing is rendered.
  void decide(const IntegratorSettings& settings, const CameraRays& camera, RatioPlaces there);
  /// What it was settled by.
  const RatioPlaces& ratios_then() const { return ratios_then_; }
  /// Makes ready, once, for directional lights that are few enough. While nothing is rendered.
  void map_shadows(const CameraRays& camera);
  const std::vector<Decision>& decisions() const { return plan_.decisions; }
  /// Whether any light is looked up.
  bool looks_up() const { return !plan_.proxies.empty(); }

  /// Mean radiance straight from the lights whose ratios are looked up if nothing blocked them, mean over the
  /// places of `records`, luminance.
  double typical_radiance(std::span<const cache::Record> records) const;

  /// Radiance scattered once in `segment`, through `medium`, against its direction, with the transmittance up
  /// to its origin; one sample of it. `epoch` may be null. Where no record reaches, light is sampled.
  PixelSample sample(const transport::MediumSegment& segment, int32_t medium, const SegmentUse& use,
                     const cache::Epoch* epoch, RandomStream& random, RayCounters& counters) const;
  /// Tells of look-ups that `sample` would make along `segment`; `throughput` weighs them.
  void observe(const transport::MediumSegment& segment, int32_t medium, const cache::Epoch* epoch,
               const Spectrum& throughput, LookUpObserver& observer) const;

 private:
  /// A light's proxy, null where the light is sampled, with the records of its ratio, null where none are.
  struct Cached {
    const derivatives::LightProxy* proxy = nullptr;
    const cache::Index* index = nullptr;
  };

  /// Of the lights of `subset`, by so many samples.
  PixelSample sample_some(const transport::MediumSegment& segment, int32_t medium,
                          transport::LightSubset subset, int32_t samples, bool wants_cached,
                          const cache::Epoch* epoch, RandomStream& random, RayCounters& counters) const;
  Cached cached(uint32_t light, int32_t medium, const cache::Epoch* epoch) const;

  std::shared_ptr<const transport::World> world_;
  bool decided_ = false;
  RatioPlaces ratios_then_;
  SingleScatteringPlan plan_;
  /// By LightSampler::parallel_lights(), then medium; none where a medium scatters nothing.
  std::vector<std::vector<std::unique_ptr<const transport::ShadowMap>>> shadow_maps_;
};

}  // namespace fogbank::integrators
