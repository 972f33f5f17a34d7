// The two-dimensional model's wire form.
#pragma once

#include <span>
#include <vector>

#include "core/vector.h"
#include "derivatives/flatland/model.h"
#include "fogbank/v1/flatland.pb.h"

namespace fogbank::service {

/// Throws RpcError INVALID_SCENE, INVALID_SETTINGS, TOO_MANY_CREASES.
derivatives::flatland::Model to_model(const v1::ProbeFlatlandRequest& request);

/// Throws RpcError INVALID_POINT, TOO_MANY_POINTS.
std::vector<Vec2d> to_points(const v1::ProbeFlatlandRequest& request,
                             const derivatives::flatland::Scene& scene);

void set_response(v1::ProbeFlatlandResponse& response, const derivatives::flatland::Settings& settings,
                  std::span<const derivatives::flatland::Estimate> estimates);

}  // namespace fogbank::service
