// Radiance caching: light that reaches a place straight from the emitters is sampled, light that is reflected
// or scattered on its way comes from records with derivatives that see occlusion.
#pragma once

#include <optional>

#include "cache/index.h"
#include "cache/photon_field.h"
#include "cache/record_maker.h"
#include "cache/scene_cache.h"
#include "integrators/camera_march.h"
#include "integrators/integrator.h"
#include "integrators/look_up_observer.h"
#include "integrators/medium_records.h"
#include "integrators/radiance_cache_pilot.h"
#include "integrators/single_scattering.h"
#include "transport/path_tracer.h"

namespace fogbank::integrators {

/// What a finished preparation leaves for rendering.
struct PublishedCache {
  std::shared_ptr<const cache::Epoch> epoch;
  double error = 0;          ///< CacheTarget::error of the epoch's metric
  uint8_t generation = 0;    ///< of the records that the camera looks up
  float typical_radius = 0;  ///< of extents at the epoch's threshold, > 0: the step where no record reaches
  /// That the photons come from which end paths where no record reaches; 0: none do.
  uint32_t photon_paths = 0;
};

class RadianceCacheIntegrator final : public Integrator {
 public:
  RadianceCacheIntegrator(std::shared_ptr<const transport::World> world, const IntegratorSettings& settings,
                          const CacheTechnique& technique = {});

  /// Against the epoch that the preparation published. Where no record reaches, a path takes its place.
  PixelSample sample(const Ray& ray, RandomStream& random, RayCounters& counters) const override;
  PixelSample sample_without_cache(const Ray& ray, RandomStream& random,
                                   RayCounters& counters) const override;
  std::unique_ptr<Preparation> prepare(const CameraRays& camera, const CacheTarget& target) override;
  CacheCounts cache_counts() const override;
  std::vector<Decision> decisions() const override;
  CacheView cache_view(const Ray& ray, RandomStream& random, RayCounters& counters) const override;
  std::shared_ptr<const cache::Epoch> epoch() const override { return published_.epoch; }

  // radiance_cache_state.cpp:

  std::optional<std::string> state() const override;
  void restore(const CameraRays& camera, std::string_view state) override;

  /// Tells `observer` of all look-ups along a camera path up to the first surface that scatters it in a
  /// random direction; samples nothing.
  void observe(const Ray& ray, RandomStream& random, RayCounters& counters, LookUpObserver& observer) const;

  std::shared_ptr<const transport::World> world() const { return world_; }
  const IntegratorSettings& settings() const { return settings_; }
  const CacheTechnique& technique() const { return technique_; }
  const SingleScatteringTerm& single_scattering() const { return single_scattering_; }
  cache::SceneCache& cache() { return *cache_; }
  CachePilot& pilot() { return pilot_; }
  const PublishedCache& published() const { return published_; }
  /// Where paths in dense media end: at those of so many photons' paths. Kept until another number is asked
  /// for; by one thread at a time.
  const std::shared_ptr<cache::PhotonField>& photons(uint32_t paths);
  /// While nothing is rendered.
  void publish(PublishedCache published, uint64_t records_new);

 private:
  struct Walk;

  PixelSample walk_from(const Ray& ray, bool wants_cached, RandomStream& random, RayCounters& counters,
                        LookUpObserver* observer) const;
  /// Everything that arrives along the walk's ray.
  PixelSample follow(Walk& walk, RandomStream& random, RayCounters& counters) const;
  PixelSample from_medium(const Walk& walk, const transport::MediumSegment& segment, RandomStream& random,
                          RayCounters& counters) const;
  /// Light of one quantity that the segment scatters, from records as far as the scene goes.
  PixelSample from_cache(const Walk& walk, const transport::MediumSegment& segment, cache::Quantity quantity,
                         RandomStream& random, RayCounters& counters) const;
  /// The part of it about the scene.
  Spectrum from_records(const Walk& walk, const transport::MediumSegment& segment, cache::Quantity quantity,
                        const CameraMarch& march, RandomStream& random, RayCounters& counters) const;
  /// Light scattered more than once, at one random place: where a segment's direction is random already.
  PixelSample from_random_place(const Walk& walk, const transport::MediumSegment& segment,
                                cache::Quantity quantity, RandomStream& random, RayCounters& counters) const;
  /// Light of one quantity that the segment scatters outside [first, last], sampled.
  Spectrum from_beyond(const Walk& walk, const transport::MediumSegment& segment, cache::Quantity quantity,
                       float first, float last, RandomStream& random, RayCounters& counters) const;
  void report(const Walk& walk, const transport::MediumSegment& segment, cache::Quantity quantity,
              const CameraMarch& march, const cache::VisibilityTest& visibility) const;
  /// What a record of the quantity would say at a place, sampled; per sigma_s, scattered against `direction`.
  Spectrum uncached_light(const Walk& walk, const transport::MediumInfo& medium, cache::Quantity quantity,
                          const Vec3f& position, const Vec3f& direction, RandomStream& random,
                          RayCounters& counters) const;
  /// Light that comes to `position` by at least one more scattering event and is scattered against
  /// `direction`, per sigma_s: one path.
  Spectrum scattered_path(const Walk& walk, const transport::MediumInfo& medium, const Vec3f& position,
                          const Vec3f& direction, RandomStream& random, RayCounters& counters) const;
  /// Light that arrives along `ray`, scattered on its way; emission met by the ray itself is left out. `walk`
  /// ends at the ray's origin. Sampled to the next records where the camera sees that place, as it would see
  /// noise; to the emitters where a random direction led there.
  Spectrum scattered_along(const Walk& walk, const Ray& ray, int32_t medium, RandomStream& random,
                           RayCounters& counters) const;
  PixelSample from_surface(Walk& walk, const scene::SurfaceInteraction& surface, RandomStream& random,
                           RayCounters& counters) const;
  /// Light that reaches a Lambertian surface by at least one scattering event: what it would send out if it
  /// were white. `side`: unit normal to the side that is seen.
  Spectrum arriving_at(const Walk& walk, const scene::SurfaceInteraction& surface, const Vec3f& side,
                       const Spectrum& reflectance, RandomStream& random, RayCounters& counters) const;
  /// The same where no record reaches.
  Spectrum arriving_by_paths(const Walk& walk, const scene::SurfaceInteraction& surface, const Vec3f& side,
                             RandomStream& random, RayCounters& counters) const;
  /// Draws the path's next direction; false where it ends.
  bool go_on(Walk& walk, const scene::SurfaceInteraction& surface, const transport::Bsdf& bsdf,
             const transport::ShadingPoint& point, const Vec3f& wo, RandomStream& random) const;
  Spectrum emission(const Walk& walk, const scene::SurfaceInteraction* surface) const;
  bool may_scatter(const Walk& walk) const;
  cache::Component medium_component(const Walk& walk, cache::Quantity quantity) const;
  const cache::Index* find(const cache::Component& component) const;

  std::shared_ptr<const transport::World> world_;
  IntegratorSettings settings_;
  CacheTechnique technique_;
  transport::PathTracer kernel_;
  SingleScatteringTerm single_scattering_;
  std::shared_ptr<cache::SceneCache> cache_;
  uint64_t records_at_start_ = 0;
  uint64_t records_new_ = 0;
  CachePilot pilot_;
  PublishedCache published_;
  std::shared_ptr<cache::PhotonField> photons_;
  std::shared_ptr<cache::PhotonField> ending_photons_;  ///< of `kernel_`, may be null
};

}  // namespace fogbank::integrators
