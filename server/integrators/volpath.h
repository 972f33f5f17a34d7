// Volumetric path tracing: unbiased, the reference for everything else.
//
// Surfaces: next-event estimation and BSDF sampling, combined by multiple importance sampling (power
// heuristic). Media: along every segment the light scattered in once is estimated apart from the path's
// continuation. Its distance is drawn from the tabulated importance of one light (transmittance times the
// closed-form unoccluded proxy Mhat, ratio-records.md sections 1 and 4), its direction by the light's solid
// angle; the continuation draws its distance by transmittance (per channel, one-sample spectral MIS) and its
// direction from the phase function. Both can reach an emitter with an extent, so they are combined by MIS
// over the product density of distance and direction.
#pragma once

#include <memory>

#include "integrators/integrator.h"
#include "transport/world.h"

namespace fogbank::integrators {

class VolumetricPathTracer final : public Integrator {
 public:
  VolumetricPathTracer(std::shared_ptr<const transport::World> world, const IntegratorSettings& settings)
      : world_(std::move(world)), settings_(settings) {}

  Spectrum radiance(const Ray& ray, RandomStream& random, RayCounters& counters) const override;

 private:
  struct Path;

  Spectrum in_scattered(const Path& path, const transport::MediumSegment& segment, int32_t samples,
                        RandomStream& random, RayCounters& counters) const;
  /// Light reflected at `surface` towards where the ray came from, by next-event estimation.
  Spectrum direct_light(const scene::SurfaceInteraction& surface, const Vec3f& ray_direction, int32_t medium,
                        RandomStream& random, RayCounters& counters) const;
  transport::LightReceiver receiver_at(const scene::SurfaceInteraction& surface, const transport::Bsdf& bsdf,
                                       float cos_viewer, int32_t medium) const;
  /// Emission met by the path's ray, weighted by MIS: of `surface`, or of the environment when null.
  Spectrum emission(const Path& path, const scene::SurfaceInteraction* surface) const;
  float emitter_weight(const Path& path, uint32_t light, const Vec3f& direction,
                       const scene::SurfaceInteraction* hit) const;
  bool survives_roulette(Path& path, RandomStream& random) const;

  std::shared_ptr<const transport::World> world_;
  IntegratorSettings settings_;
};

}  // namespace fogbank::integrators
