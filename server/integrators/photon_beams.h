// Progressive photon beams (Jarosz et al. 2011, "Progressive Photon Beams"): every sample of the pixels looks
// at photons of its own, with a radius that shrinks from sample to sample, so that noise and blur both go to
// zero while memory stays the same (Knaus and Zwicker 2011, "Progressive Photon Mapping: A Probabilistic
// Approach"). It finds what paths from the camera can't: caustics of small lights, through fog as on
// surfaces.
//
// Sample number n of every pixel is a function of scene, camera, settings, seed and n. The paths of photons
// begin where a pilot found that they matter for the picture (transport::EmissionGuide).
#pragma once

#include <memory>
#include <optional>

#include "integrators/integrator.h"
#include "integrators/photon_gather.h"
#include "transport/emission_guide.h"
#include "transport/light_emission.h"
#include "transport/photon_tracer.h"

namespace fogbank::integrators {

/// What a pilot finds out before the first pass.
struct PhotonPlan {
  transport::EmissionGuide guide;
  uint32_t paths = 0;        ///< of a pass, a multiple of `beam_stride`; 0: there is no light
  uint32_t beam_stride = 1;  ///< every how many-th path leaves beams; all leave photons on surfaces
  float beam_radius = 0;     ///< of the first sample, scene units
  float surface_radius = 0;  ///< the same for photons on surfaces
};

class PhotonBeamsIntegrator final : public Integrator {
 public:
  /// Beams that a pass is to have, about: one for four pixels of the whole film, but within these limits;
  /// where nothing scatters in media, paths. That bounds the paths, and so memory: up to 1.3 KiB a beam,
  /// 170 MiB in all, and 130 bytes a photon on a surface, of which a path leaves a few.
  static constexpr uint32_t least_beams = uint32_t{1} << 12;
  static constexpr uint32_t most_beams = uint32_t{1} << 17;

  PhotonBeamsIntegrator(std::shared_ptr<const transport::World> world, const IntegratorSettings& settings);

  /// Throws std::logic_error unless its sample number has been prepared.
  PixelSample sample(const Ray& ray, RandomStream& random, RayCounters& counters) const override;
  bool blurs() const override { return true; }
  uint32_t most_samples_of_pass() const override { return 1; }
  bool prepares_passes() const override { return true; }
  std::unique_ptr<Preparation> prepare_pass(const CameraRays& camera, const PassSamples& samples) override;

  /// Made by the first `prepare_pass`.
  const transport::LightEmission& emission() const { return *emission_; }
  const transport::PhotonTracer& tracer() const { return tracer_; }
  const PhotonGather& gather() const { return gather_; }
  const std::optional<PhotonPlan>& plan() const { return plan_; }
  /// While nothing is rendered.
  void set_plan(PhotonPlan plan) { plan_ = std::move(plan); }
  void publish(std::unique_ptr<const PhotonPass> pass) { pass_ = std::move(pass); }

  /// Radii of sample n over those of sample 0.
  struct Shrinking {
    float beams = 1;
    float surfaces = 1;
  };
  static Shrinking shrinking(uint32_t sample);

 private:
  std::shared_ptr<const transport::World> world_;
  std::optional<transport::LightEmission> emission_;
  transport::PhotonTracer tracer_;
  PhotonGather gather_;
  std::optional<PhotonPlan> plan_;
  std::unique_ptr<const PhotonPass> pass_;
};

}  // namespace fogbank::integrators
