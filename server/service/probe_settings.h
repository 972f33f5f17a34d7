// From the settings of a probe to those of the engine, and to the effective ones that the stream echoes.
#pragma once

#include "derivatives/estimator.h"
#include "fogbank/v1/probe.pb.h"
#include "scene/scene.h"
#include "transport/plan.h"

namespace fogbank::service {

/// Settings with every default filled in.
struct ResolvedProbe {
  derivatives::EstimatorSettings engine;
  v1::ProbeSettings effective;  ///< `method` is one that exists
};

/// Throws RpcError INVALID_SETTINGS, naming the field of the request, for whatever is out of range.
ResolvedProbe resolve_probe(const v1::ProbeSettings& requested, const scene::Scene& scene);
transport::PlanRequest resolve_plan(const v1::GetPlanRequest& requested, const scene::Scene& scene);

}  // namespace fogbank::service
