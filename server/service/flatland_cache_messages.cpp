// The two-dimensional cache's part of the wire form.
#include <algorithm>
#include <cmath>
#include <utility>

#include "core/error.h"
#include "service/field_errors.h"
#include "service/flatland_messages.h"
#include "service/rpc_error.h"

namespace fogbank::service {

namespace {

constexpr int32_t default_pilot = 64;

cache::flatland::Metric to_engine(v1::FlatlandMetric metric) {
  switch (metric) {
    case v1::FLATLAND_METRIC_UNSPECIFIED:
    case v1::FLATLAND_METRIC_SECOND_ORDER:
      return cache::flatland::Metric::second_order;
    case v1::FLATLAND_METRIC_FIRST_ORDER:
      return cache::flatland::Metric::first_order;
    default:
      refuse_field("cache.metric", "is not a FlatlandMetric");
  }
}

cache::Shape to_engine(v1::FlatlandShape shape) {
  switch (shape) {
    case v1::FLATLAND_SHAPE_UNSPECIFIED:
    case v1::FLATLAND_SHAPE_ELLIPSE:
      return cache::Shape::ellipsoid;
    case v1::FLATLAND_SHAPE_CIRCLE:
      return cache::Shape::sphere;
    default:
      refuse_field("cache.shape", "is not a FlatlandShape");
  }
}

cache::flatland::Settings to_engine(const v1::FlatlandCacheSettings& message, const Vec2d& box_size,
                                    size_t points) {
  cache::flatland::Settings settings;
  settings.metric = to_engine(message.metric());
  settings.threshold = message.threshold();
  settings.shape = to_engine(message.shape());
  settings.maximum_radius = std::max(box_size.x, box_size.y) / 4;
  settings.minimum_radius = 0.99 * std::sqrt(box_size.x / static_cast<double>(points) * box_size.y);
  if (message.has_maximum_anisotropy()) settings.maximum_anisotropy = message.maximum_anisotropy();
  if (message.has_maximum_radius()) settings.maximum_radius = message.maximum_radius();
  if (message.has_minimum_radius()) settings.minimum_radius = message.minimum_radius();
  if (message.has_neighbour_clamp()) settings.guards.neighbour_clamp = message.neighbour_clamp();
  if (message.has_visibility_margin()) settings.guards.visibility_margin = message.visibility_margin();
  if (message.has_verify()) settings.guards.verify = message.verify();
  if (message.has_depth()) settings.guards.depth = message.depth();
  return settings;
}

}  // namespace

FlatlandFill to_fill(const v1::FlatlandCacheSettings& message,
                     std::shared_ptr<const derivatives::flatland::Model> model, std::vector<Vec2d> points) {
  if (points.empty()) {
    throw RpcError(grpc::StatusCode::INVALID_ARGUMENT, "INVALID_POINT", "points: there is none",
                   {{"field", "points"}});
  }
  const derivatives::flatland::Scene& scene = model->scene();
  const auto settings = to_engine(message, scene.box_max() - scene.box_min(), points.size());
  const int32_t pilot = message.has_pilot()
                            ? message.pilot()
                            : static_cast<int32_t>(std::min<size_t>(default_pilot, points.size()));
  if (pilot < 1) refuse_field("cache.pilot", "must be positive");
  try {
    return {settings, pilot,
            cache::flatland::Fill(std::move(model), settings, std::move(points), static_cast<size_t>(pilot))};
  } catch (const Error& error) {
    const EngineFieldError parts(error);
    refuse_field("cache." + parts.field, parts.message);
  }
}

void set_effective(v1::FlatlandCacheSettings& effective, const FlatlandFill& fill) {
  const cache::flatland::Settings& settings = fill.settings;
  effective.set_metric(settings.metric == cache::flatland::Metric::second_order
                           ? v1::FLATLAND_METRIC_SECOND_ORDER
                           : v1::FLATLAND_METRIC_FIRST_ORDER);
  effective.set_threshold(settings.threshold);
  effective.set_shape(settings.shape == cache::Shape::ellipsoid ? v1::FLATLAND_SHAPE_ELLIPSE
                                                                : v1::FLATLAND_SHAPE_CIRCLE);
  effective.set_maximum_anisotropy(settings.maximum_anisotropy);
  effective.set_maximum_radius(settings.maximum_radius);
  effective.set_minimum_radius(settings.minimum_radius);
  effective.set_neighbour_clamp(settings.guards.neighbour_clamp);
  effective.set_visibility_margin(settings.guards.visibility_margin);
  effective.set_verify(settings.guards.verify);
  effective.set_depth(settings.guards.depth);
  effective.set_pilot(fill.pilot);
}

void set_response(v1::FillFlatlandCacheResponse& response, const FlatlandFill& fill) {
  set_effective(*response.mutable_cache(), fill);
  for (const double radiance : fill.fill.radiance()) response.add_radiance(radiance);
  const cache::flatland::Cache& cache = fill.fill.cache();
  for (size_t i = 0; i < cache.size(); ++i) {
    const cache::flatland::Ellipse& extent = cache.extent(i);
    for (int axis = 0; axis < 2; ++axis) {
      response.add_record_coordinates(cache.record(i).position[axis]);
      response.add_record_axis(extent.axis[axis]);
    }
    for (const double semi_axis : extent.semi_axes) response.add_record_semi_axes(semi_axis);
  }
  response.set_rays(fill.fill.rays());
}

}  // namespace fogbank::service
