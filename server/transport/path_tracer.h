// The path-tracing kernel: unbiased estimates of radiance along rays, leaving surfaces and inside media.
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
#include <optional>

#include "core/random.h"
#include "transport/direct_light.h"
#include "transport/world.h"

namespace fogbank::transport {

struct PathSettings {
  int32_t max_depth =
      -1;  ///< edges of a whole path, as Mitsuba's: 1 = emitted light only, 2 = one bounce; -1 = unbounded
  int32_t rr_depth = 2;        ///< Russian roulette by throughput from this number of scattering events on
  bool hide_emitters = false;  ///< from camera rays
  /// That camera rays start in, scene::none for vacuum; nothing: that of the scene file's camera.
  std::optional<int32_t> camera_medium = std::nullopt;
};

/// Light in media that needn't be traced any further.
class KnownRadiance {
 public:
  virtual ~KnownRadiance() = default;
  /// Mean radiance (fluence / 4 pi) at `y` in `medium` of light that comes from at least one scattering
  /// event; nullopt where it isn't known, always where the phase function isn't isotropic. Finite, >= 0.
  virtual std::optional<Spectrum> scattered_before(const Vec3f& y, int32_t medium) const = 0;
};

/// Immutable; one instance serves all threads, each of which has called scene::prepare_render_thread(). Every
/// function draws one sample, linear sRGB, >= 0, from the stream it is given and from nothing else; a sample
/// is finite unless the scene's own numbers overflow.
class PathTracer {
 public:
  /// Paths end where they are scattered in a medium and `known`, which may be null, tells the rest.
  PathTracer(std::shared_ptr<const World> world, const PathSettings& settings,
             std::shared_ptr<const KnownRadiance> known = nullptr)
      : world_(std::move(world)), settings_(settings), known_(std::move(known)) {}

  const World& world() const { return *world_; }
  const PathSettings& settings() const { return settings_; }

  /// Radiance that arrives along a camera ray.
  Spectrum radiance(const Ray& ray, RandomStream& random, RayCounters& counters) const;

  /// Radiance that `surface` sends against `ray_direction` because it scatters light: reflected and
  /// refracted, without its own emission and without what comes straight on through it (null and mask
  /// components), which belongs to whoever follows the ray further. `medium`: where the ray arrives,
  /// scene::none for vacuum. `depth`: scattering events before this one, so that the light sampled here ends
  /// a path of depth + 2 edges.
  Spectrum scattered_radiance(const scene::SurfaceInteraction& surface, const Vec3f& ray_direction,
                              int32_t medium, int32_t depth, RandomStream& random,
                              RayCounters& counters) const;

  /// Radiance that arrives along `ray` from surfaces that scatter light and from the medium that holds the
  /// ray's origin (scene::none: vacuum); emission met by the ray itself is left out. `depth` as above, the
  /// event at the ray's origin included. `first_hit`: the surface that ends the ray, of infinite distance
  /// where there is none.
  Spectrum arriving_radiance(const Ray& ray, int32_t medium, int32_t depth, RandomStream& random,
                             RayCounters& counters, scene::Hit* first_hit) const;

  /// The light at `position`, which `medium` holds, as a ray of `ray_direction` sees it: one path for both
  /// numbers. `depth` as above.
  MediumLight light_in_medium(const Vec3f& position, const Vec3f& ray_direction, int32_t medium,
                              int32_t depth, RandomStream& random, RayCounters& counters) const;

  /// Mean incoming radiance (fluence / 4 pi) at `position` in `medium` (scene::none for vacuum), whatever the
  /// medium's phase function. `depth` as above.
  Spectrum mean_radiance(const Vec3f& position, int32_t medium, int32_t depth, RandomStream& random,
                         RayCounters& counters) const;

 private:
  struct Path;

  /// Everything that arrives along the path's ray.
  Spectrum trace(Path& path, RandomStream& random, RayCounters& counters) const;
  /// Emission met by the path's ray, weighted by MIS: of `surface`, or of the environment when null.
  Spectrum emission(const Path& path, const scene::SurfaceInteraction* surface) const;
  float emitter_weight(const Path& path, uint32_t light, const Vec3f& direction,
                       const scene::SurfaceInteraction* hit) const;
  bool survives_roulette(Path& path, RandomStream& random) const;
  /// May the path scatter once more and then still reach a light?
  bool may_scatter(const Path& path) const;
  /// Goes on from `surface` in a direction drawn from its BSDF; false where the path ends.
  bool scatter(Path& path, const scene::SurfaceInteraction& surface, RandomStream& random) const;
  /// Of light that media scatter: a path that may end can't meet what sampling the lights leaves to it.
  EmissionFoundBy emission_in_media() const {
    return known_ ? EmissionFoundBy::light_sampling : EmissionFoundBy::light_and_path_sampling;
  }

  std::shared_ptr<const World> world_;
  PathSettings settings_;
  std::shared_ptr<const KnownRadiance> known_;
};

}  // namespace fogbank::transport
