// Radiance caching: light that reaches a place straight from the emitters is sampled, light that is reflected
// or scattered on its way comes from records with derivatives that see occlusion.
#pragma once

#include "cache/index.h"
#include "cache/record_maker.h"
#include "cache/scene_cache.h"
#include "integrators/integrator.h"
#include "integrators/single_scattering.h"
#include "transport/path_tracer.h"

namespace fogbank::integrators {

class RadianceCacheIntegrator final : public Integrator {
 public:
  RadianceCacheIntegrator(std::shared_ptr<const transport::World> world, const IntegratorSettings& settings);

  /// Against the epoch that the preparation published. Where no record reaches, a path takes its place.
  PixelSample sample(const Ray& ray, RandomStream& random, RayCounters& counters) const override;
  std::unique_ptr<Preparation> prepare(const CameraRays& camera, const CacheTarget& target) override;
  CacheCounts cache_counts() const override;

  /// `uncovered`: told of every place that no record reaches; nothing is sampled then.
  PixelSample walk_from(const Ray& ray, RandomStream& random, RayCounters& counters,
                        std::vector<cache::Wish>* uncovered) const;

  std::shared_ptr<const transport::World> world() const { return world_; }
  const IntegratorSettings& settings() const { return settings_; }
  cache::SceneCache& cache() { return *cache_; }
  /// While nothing is rendered.
  void publish(std::shared_ptr<const cache::Epoch> epoch, uint64_t records_new);

 private:
  struct Walk;

  PixelSample from_medium(const Walk& walk, const transport::MediumSegment& segment, RandomStream& random,
                          RayCounters& counters) const;
  Spectrum from_surface(Walk& walk, const scene::SurfaceInteraction& surface, RandomStream& random,
                        RayCounters& counters) const;
  /// Draws the path's next direction; false where it ends.
  bool go_on(Walk& walk, const scene::SurfaceInteraction& surface, const transport::Bsdf& bsdf,
             const transport::ShadingPoint& point, const Vec3f& wo, RandomStream& random) const;
  Spectrum emission(const Walk& walk, const scene::SurfaceInteraction* surface) const;
  bool may_scatter(const Walk& walk) const;

  std::shared_ptr<const transport::World> world_;
  IntegratorSettings settings_;
  transport::PathTracer kernel_;
  SingleScatteringTerm single_scattering_;
  std::shared_ptr<cache::SceneCache> cache_;
  uint64_t records_at_start_ = 0;
  uint64_t records_new_ = 0;
  std::shared_ptr<const cache::Epoch> epoch_;
};

}  // namespace fogbank::integrators
