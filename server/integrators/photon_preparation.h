// What photon beams have to do before a pass: trace paths of photons, sort what they leave; before the first
// pass also a pilot that finds out where paths should begin and how large the radii should be.
#pragma once

#include <vector>

#include "integrators/photon_beams.h"

namespace fogbank::integrators {

class PhotonPreparation final : public Preparation {
 public:
  PhotonPreparation(PhotonBeamsIntegrator& integrator, const CameraRays& camera, const PassSamples& samples)
      : integrator_(integrator), camera_(camera), samples_(samples) {}

  uint32_t next_round() override;
  void run(uint32_t task, RayCounters& counters) override;
  double fraction() const override;

 private:
  enum class Round : uint8_t { begin, tracing, building, looking, done };

  /// One camera ray of the pilot.
  struct Look {
    float radiance = 0;                              ///< luminance
    std::vector<std::pair<uint32_t, float>> shares;  ///< of paths in it
    uint32_t beams = 0;
    uint32_t photons = 0;
    uint32_t surfaces = 0;  ///< that asked for photons
  };
  class LookObserver;

  bool piloting() const { return !integrator_.plan(); }
  void trace(uint32_t task, RayCounters& counters);
  void look(uint32_t row, RayCounters& counters);
  Ray pilot_ray(uint32_t column, uint32_t row, RandomStream& random) const;
  /// How far the camera sees: a length that radii are measured by.
  float typical_distance() const;
  uint32_t begin_tracing();
  uint32_t begin_building();
  /// Luminance that each ray of the pilot may be expected to have, from its neighbours.
  std::vector<double> typical_radiance() const;
  /// Of the rays looked at: what each path was worth.
  void learn();
  PhotonPlan make_plan() const;

  PhotonBeamsIntegrator& integrator_;
  const CameraRays& camera_;
  PassSamples samples_;
  Round round_ = Round::begin;
  uint32_t attempt_ = 0;  ///< of the pilot
  float distance_ = 0;    ///< typical; of the pilot
  transport::EmissionGuide guide_;
  std::vector<transport::EmissionTrial> trials_;  ///< of all attempts
  uint32_t paths_ = 0;
  uint32_t beam_stride_ = 1;                              ///< PhotonPlan::beam_stride
  std::vector<transport::Photons> traced_;                ///< by task
  std::vector<transport::EmissionGuide::Sample> points_;  ///< by path; of the pilot
  uint64_t beams_ = 0;                                    ///< of all paths
  uint64_t photons_ = 0;
  float beam_radius_ = 0;
  float surface_radius_ = 0;
  std::unique_ptr<PhotonPass> pass_;
  std::vector<Look> looks_;
};

}  // namespace fogbank::integrators
