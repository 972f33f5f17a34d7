// What an estimator's settings ask of the scene's plan.
#pragma once

#include "derivatives/estimator.h"
#include "transport/plan.h"

namespace fogbank::derivatives {

inline transport::PlanRequest plan_request(const EstimatorSettings& settings) {
  return {.from_surfaces = settings.order != Order::multiple,
          .from_medium = settings.order != Order::single,
          .max_depth = settings.max_depth,
          .leave_out = settings.leave_out};
}

}  // namespace fogbank::derivatives
