#include "service/flatland_messages.h"

#include <string>

#include "core/error.h"
#include "service/field_errors.h"
#include "service/limits.h"
#include "service/rpc_error.h"

namespace fogbank::service {

namespace flatland = derivatives::flatland;

namespace {

flatland::Method to_engine(v1::FlatlandMethod method) {
  switch (method) {
    case v1::FLATLAND_METHOD_EXACT:
      return flatland::Method::exact;
    case v1::FLATLAND_METHOD_UNAWARE:
      return flatland::Method::unaware;
    case v1::FLATLAND_METHOD_UNSPECIFIED:
    case v1::FLATLAND_METHOD_AWARE:
      return flatland::Method::aware;
    default:
      refuse_field("settings.method", "is not a FlatlandMethod");
  }
}

derivatives::Order to_engine(v1::FlatlandOrder order) {
  switch (order) {
    case v1::FLATLAND_ORDER_SINGLE:
      return derivatives::Order::single;
    case v1::FLATLAND_ORDER_MULTIPLE:
      return derivatives::Order::multiple;
    case v1::FLATLAND_ORDER_UNSPECIFIED:
    case v1::FLATLAND_ORDER_BOTH:
      return derivatives::Order::both;
    default:
      refuse_field("settings.order", "is not a FlatlandOrder");
  }
}

v1::FlatlandMethod to_message(flatland::Method method) {
  switch (method) {
    case flatland::Method::exact:
      return v1::FLATLAND_METHOD_EXACT;
    case flatland::Method::unaware:
      return v1::FLATLAND_METHOD_UNAWARE;
    case flatland::Method::aware:
      break;
  }
  return v1::FLATLAND_METHOD_AWARE;
}

v1::FlatlandOrder to_message(derivatives::Order order) {
  switch (order) {
    case derivatives::Order::single:
      return v1::FLATLAND_ORDER_SINGLE;
    case derivatives::Order::multiple:
      return v1::FLATLAND_ORDER_MULTIPLE;
    case derivatives::Order::both:
      break;
  }
  return v1::FLATLAND_ORDER_BOTH;
}

Vec2d to_engine(const v1::FlatlandPoint& point) { return {point.x(), point.y()}; }

flatland::SceneDescription to_engine(const v1::FlatlandScene& message) {
  flatland::SceneDescription scene;
  if (message.has_box_min()) scene.box_min = to_engine(message.box_min());
  if (message.has_box_max()) scene.box_max = to_engine(message.box_max());
  if (message.has_sigma_t()) scene.sigma_t = message.sigma_t();
  if (message.has_albedo()) scene.albedo = message.albedo();
  for (const v1::FlatlandSegment& segment : message.segments())
    scene.segments.push_back({to_engine(segment.start()), to_engine(segment.end()), segment.radiance()});
  return scene;
}

flatland::Settings to_engine(const v1::FlatlandSettings& message) {
  flatland::Settings settings;
  settings.method = to_engine(message.method());
  settings.order = to_engine(message.order());
  settings.seed = message.seed();
  if (message.has_samples()) settings.samples = message.samples();
  if (message.has_bisections()) settings.bisections = message.bisections();
  if (message.has_mean_rule()) settings.mean_rule = message.mean_rule();
  if (message.has_sliding()) settings.sliding = message.sliding();
  if (message.has_ratio()) settings.ratio = message.ratio();
  if (message.has_subtract()) settings.subtract = message.subtract();
  if (message.has_obliquity()) settings.obliquity = message.obliquity();
  if (message.has_march_step()) {
    settings.march_step = message.march_step();
    // 0 means the default to the engine, here a field that is left out does.
    if (settings.march_step == 0) refuse_field("settings.march_step", "must be positive");
  }
  return settings;
}

/// The engine's refusal of a field, with the field as the request names it.
RpcError with_field(const Error& error, const char* prefix) {
  const EngineFieldError parts(error);
  const std::string field = prefix + parts.field;
  return {
      grpc::StatusCode::INVALID_ARGUMENT, error.reason(), field + ": " + parts.message, {{"field", field}}};
}

}  // namespace

flatland::Model to_model(const v1::FlatlandScene& scene, const v1::FlatlandSettings& settings) {
  const flatland::SceneDescription description = to_engine(scene);
  const flatland::Settings effective = to_engine(settings);
  try {
    return {description, effective};
  } catch (const Error& error) {
    if (error.reason() == "INVALID_SCENE") throw with_field(error, "scene.");
    if (error.reason() == "INVALID_SETTINGS") throw with_field(error, "settings.");
    throw;
  }
}

std::vector<Vec2d> to_points(const google::protobuf::RepeatedField<double>& coordinates,
                             const flatland::Scene& scene, int64_t most, const char* limit) {
  const int count = coordinates.size() / 2;
  const auto refuse = [](int point, const std::string& why) {
    const std::string field = "points[" + std::to_string(point) + "]";
    throw RpcError(grpc::StatusCode::INVALID_ARGUMENT, "INVALID_POINT", field + ": " + why,
                   {{"field", field}});
  };
  if (coordinates.size() > 2 * most) {
    throw RpcError(grpc::StatusCode::RESOURCE_EXHAUSTED, "TOO_MANY_POINTS",
                   std::to_string(count) + " points; at most " + std::to_string(most) + " are allowed",
                   {{"limit", limit}});
  }
  if (coordinates.size() % 2 != 0) refuse(count, "needs x and y");
  std::vector<Vec2d> points;
  points.reserve(static_cast<size_t>(count));
  for (int i = 0; i < count; ++i) {
    const Vec2d& x = points.emplace_back(coordinates[2 * i], coordinates[2 * i + 1]);
    try {
      scene.check_point(x);
    } catch (const Error& error) {
      refuse(i, error.what());
    }
  }
  return points;
}

void set_effective(v1::FlatlandSettings& effective, const flatland::Settings& settings) {
  effective.set_method(to_message(settings.method));
  effective.set_order(to_message(settings.order));
  effective.set_samples(settings.samples);
  effective.set_seed(settings.seed);
  effective.set_bisections(settings.bisections);
  effective.set_mean_rule(settings.mean_rule);
  effective.set_sliding(settings.sliding);
  effective.set_ratio(settings.ratio);
  effective.set_subtract(settings.subtract);
  effective.set_obliquity(settings.obliquity);
  effective.set_march_step(settings.march_step);
}

void set_response(v1::ProbeFlatlandResponse& response, std::span<const flatland::Estimate> estimates) {
  for (const flatland::Estimate& estimate : estimates) {
    response.add_radiance(estimate.mean.value);
    response.add_gradient(estimate.mean.gradient.x);
    response.add_gradient(estimate.mean.gradient.y);
    for (const double entry : estimate.mean.hessian.entries) response.add_hessian(entry);
    response.add_stratified_mean(estimate.stratified_mean);
    response.add_rays(estimate.rays);
  }
}

}  // namespace fogbank::service
