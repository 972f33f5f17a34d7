// The two-dimensional model's wire form.
#pragma once

#include <memory>
#include <span>
#include <vector>

#include "cache/flatland/fill.h"
#include "core/vector.h"
#include "derivatives/flatland/model.h"
#include "fogbank/v1/flatland.pb.h"

namespace fogbank::service {

/// Throws RpcError INVALID_SCENE, INVALID_SETTINGS, TOO_MANY_CREASES.
derivatives::flatland::Model to_model(const v1::FlatlandScene& scene, const v1::FlatlandSettings& settings);

/// x and y of at most `most` points, a limit of the name `limit`. Throws RpcError INVALID_POINT,
/// TOO_MANY_POINTS.
std::vector<Vec2d> to_points(const google::protobuf::RepeatedField<double>& coordinates,
                             const derivatives::flatland::Scene& scene, int64_t most, const char* limit);

/// A fill with every default of its settings filled in.
struct FlatlandFill {
  cache::flatland::Settings settings;
  int32_t pilot = 0;
  cache::flatland::Fill fill;
};

/// Throws RpcError INVALID_SETTINGS, INVALID_POINT.
FlatlandFill to_fill(const v1::FlatlandCacheSettings& message,
                     std::shared_ptr<const derivatives::flatland::Model> model, std::vector<Vec2d> points);

void set_effective(v1::FlatlandSettings& effective, const derivatives::flatland::Settings& settings);

/// All but the settings of the model.
void set_response(v1::ProbeFlatlandResponse& response,
                  std::span<const derivatives::flatland::Estimate> estimates);
void set_response(v1::FillFlatlandCacheResponse& response, const FlatlandFill& fill);

}  // namespace fogbank::service
