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

struct SingleScatteringPlan {
  /// On: ratio records of a light are looked up. One for each light, or a single one for too many.
  std::vector<Decision> decisions;
  /// By light, then medium: what its ratios rest on; a light that is sampled has none. Empty where all are.
  std::vector<std::vector<std::optional<derivatives::LightProxy>>> proxies;
};

/// How many places have records of ratios, by light; of lights past the end: none.
using RatioPlaces = std::vector<uint64_t>;
RatioPlaces ratio_places(const cache::RecordSet& records);

/// Where the settings leave it open, records of a light are looked up if what remains of them to be computed
/// costs less CPU time than the shadow rays that they save: a function of the arguments alone. `there`: what
/// need not be computed.
SingleScatteringPlan single_scattering_plan(const transport::World& world, const IntegratorSettings& settings,
                                            const CameraRays& camera, const RatioPlaces& there);

}  // namespace fogbank::integrators
