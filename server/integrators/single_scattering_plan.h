// How the single scattering of each light gets into a picture, and why.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "cache/record_set.h"
#include "derivatives/light_proxy.h"
#include "integrators/integrator.h"
#include "transport/world.h"

namespace fogbank::integrators {

struct LightTechnique {
  Decision decision;  ///< on: ratio records are looked up
  /// By medium; empty where the light is sampled.
  std::vector<std::optional<derivatives::LightProxy>> proxies;
};

/// One for each light of the world. Where the settings leave it open, records are looked up if what remains
/// of them to be computed costs less CPU time than the shadow rays that they save: a function of the
/// arguments alone. `records`: what is there.
std::vector<LightTechnique> single_scattering_plan(const transport::World& world,
                                                   const IntegratorSettings& settings,
                                                   const CameraRays& camera, const cache::RecordSet& records);

}  // namespace fogbank::integrators
