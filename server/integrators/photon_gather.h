// The camera's side of photon beams: a path from the camera that goes on through mirrors, glass and narrow
// lobes, and gathers beams along its pieces and photons where it ends.
#pragma once

#include <optional>

#include "integrators/photon_beam_grid.h"
#include "integrators/photon_map.h"
#include "transport/path_tracer.h"

namespace fogbank::integrators {

/// What one pass's paths of photons left behind; their flux is that of the whole scene.
struct PhotonPass {
  uint32_t sample = 0;  ///< of each pixel that it is for
  std::optional<PhotonBeamGrid> beams;
  std::optional<PhotonMap> photons;
};

/// Is told what each path of photons adds to a pixel: luminance, W/(m^2 sr).
class PhotonObserver {
 public:
  virtual ~PhotonObserver() = default;
  virtual void beam(uint32_t path, float radiance) = 0;
  virtual void photon(uint32_t path, float radiance) = 0;
  /// A surface asked for its photons.
  virtual void surface() = 0;
};

/// W/(m^2 sr).
struct Gathered {
  Spectrum radiance{0};
  Spectrum narrow{0};  ///< the same with kernels of half the radius

  void add(const Spectrum& everywhere) {
    radiance += everywhere;
    narrow += everywhere;
  }
  void add(const Spectrum& throughput, const Gathered& part) {
    radiance += throughput * part.radiance;
    narrow += throughput * part.narrow;
  }
};

/// Every light path counts once. Seen from the camera, its first event in a medium or in a broad lobe of a
/// surface is where it is gathered: in a medium by beams, whatever their depth; on a surface by photons that
/// were scattered before, and by sampling the lights for light that was not. Immutable.
class PhotonGather {
 public:
  PhotonGather(std::shared_ptr<const transport::World> world, const transport::PathSettings& settings)
      : world_(std::move(world)), settings_(settings) {}

  /// One sample of the radiance that arrives along a camera ray. `observer` may be null.
  Gathered radiance(const Ray& ray, const PhotonPass& pass, RandomStream& random, RayCounters& counters,
                    PhotonObserver* observer) const;

  const transport::World& world() const { return *world_; }
  const transport::PathSettings& settings() const { return settings_; }

 private:
  struct Walk;

  /// Beam x beam estimate with a kernel across both (Jarosz et al. 2011, "A Comprehensive Theory of
  /// Volumetric Radiance Estimation Using Photon Points and Beams"), of light that the medium
  /// scatters between the ray's origin and its end.
  Gathered from_beams(const Walk& walk, float length, const PhotonPass& pass, PhotonObserver* observer) const;
  /// Photon density estimate (Jensen 1996) of light that was scattered before.
  Gathered from_photons(const Walk& walk, const scene::SurfaceInteraction& surface,
                        const transport::Bsdf& bsdf, const PhotonPass& pass, PhotonObserver* observer) const;
  Spectrum emission(const Walk& walk, const scene::SurfaceInteraction* surface) const;
  float emitter_weight(const Walk& walk, uint32_t light, const scene::SurfaceInteraction* hit) const;
  bool may_scatter(const Walk& walk) const;
  /// Draws the path's next direction; false where it ends.
  bool go_on(Walk& walk, const scene::SurfaceInteraction& surface, const transport::Bsdf& bsdf,
             RandomStream& random) const;
  bool survives_roulette(Walk& walk, RandomStream& random) const;

  std::shared_ptr<const transport::World> world_;
  transport::PathSettings settings_;
};

}  // namespace fogbank::integrators
