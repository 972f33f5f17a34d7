// Paths of photons: power that leaves the emitters, followed through surfaces and media by the adjoint of
// what PathTracer does (Veach 1997, chapters 4 and 5).
#pragma once

#include <vector>

#include "core/random.h"
#include "transport/light_emission.h"
#include "transport/path_tracer.h"

namespace fogbank::transport {

/// A straight piece of a photon's path through a medium that scatters. It stands for flux at every place
/// t < length: `flux` exp(-(sigma_t - end_rate) t), as the beam's end is drawn with the density
/// end_rate exp(-end_rate t) unless a surface ends it before: between a "long" beam (end_rate 0) and a
/// "short" one (sigma_t) of Jarosz et al. 2011.
struct PhotonBeam {
  Vec3f origin{0};
  Vec3f direction{0, 0, 1};
  float length = 0;
  Spectrum flux{0};  ///< W, at the origin
  int32_t medium = scene::none;
  uint32_t depth = 0;  ///< scattering events before it
  uint32_t path = 0;
};

/// A photon that arrives at a surface that scatters it by more than Dirac lobes, after at least one
/// scattering event.
struct SurfacePhoton {
  Vec3f position{0};
  Vec3f direction{0, 0, 1};         ///< of travel
  Vec3f geometric_normal{0, 0, 1};  ///< unit
  Spectrum flux{0};                 ///< W
  uint32_t depth = 0;               ///< scattering events before it
  uint32_t path = 0;
};

/// What paths leave behind.
struct Photons {
  std::vector<PhotonBeam> beams;
  std::vector<SurfacePhoton> on_surfaces;
};

/// Immutable; safe from any thread that has called scene::prepare_render_thread().
class PhotonTracer {
 public:
  /// `hide_emitters` means nothing here.
  PhotonTracer(std::shared_ptr<const World> world, const PathSettings& settings)
      : world_(std::move(world)), settings_(settings) {}

  /// Follows one path and appends what it leaves. All vectors are finite.
  void trace(const EmittedRay& emitted, uint32_t path, RandomStream& random, RayCounters& counters,
             Photons& photons) const;

  /// Rate at which beams in a medium end (PhotonBeam), 1/unit length.
  static float end_rate(const MediumInfo& medium);

 private:
  struct Photon;

  /// False where the path ends.
  bool scatter_in_medium(Photon& photon, const MediumInfo& medium, const MediumSegment& segment, float t,
                         RandomStream& random) const;
  bool scatter_at_surface(Photon& photon, const scene::SurfaceInteraction& surface,
                          RandomStream& random) const;
  bool survives_roulette(Photon& photon, float before, RandomStream& random) const;
  /// May what scatters the photon here still reach the camera within max_depth?
  bool may_scatter(uint32_t depth) const;

  std::shared_ptr<const World> world_;
  PathSettings settings_;
};

}  // namespace fogbank::transport
