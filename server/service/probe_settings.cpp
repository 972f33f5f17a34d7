#include "service/probe_settings.h"

#include <string>

#include "core/error.h"
#include "service/field_errors.h"

namespace fogbank::service {

using derivatives::DerivativeOrder;
using derivatives::EstimatorSettings;
using derivatives::Order;

namespace {

constexpr const char* default_method = "aware";

Order to_engine(v1::ProbeOrder order, const std::string& field) {
  switch (order) {
    case v1::PROBE_ORDER_SINGLE:
      return Order::single;
    case v1::PROBE_ORDER_MULTIPLE:
      return Order::multiple;
    case v1::PROBE_ORDER_UNSPECIFIED:
    case v1::PROBE_ORDER_BOTH:
      return Order::both;
    default:
      refuse_field(field, "is not a ProbeOrder");
  }
}

DerivativeOrder to_engine(v1::ProbeDerivatives derivatives) {
  switch (derivatives) {
    case v1::PROBE_DERIVATIVES_VALUE:
      return DerivativeOrder::value;
    case v1::PROBE_DERIVATIVES_GRADIENT:
      return DerivativeOrder::gradient;
    case v1::PROBE_DERIVATIVES_UNSPECIFIED:
    case v1::PROBE_DERIVATIVES_HESSIAN:
      return DerivativeOrder::hessian;
    default:
      refuse_field("settings.derivatives", "is not a ProbeDerivatives");
  }
}

void check_method(const std::string& name) {
  std::string known;
  for (const auto& method : derivatives::supported_methods()) {
    if (method.name == name) return;
    known += (known.empty() ? "" : ", ") + method.name;
  }
  refuse_field("settings.method", "\"" + name + "\" is not one of: " + known);
}

}  // namespace

ResolvedProbe resolve_probe(const v1::ProbeSettings& requested, const scene::Scene& scene) {
  ResolvedProbe resolved;
  EstimatorSettings& engine = resolved.engine;
  v1::ProbeSettings& effective = resolved.effective;
  effective = requested;
  if (requested.method().empty()) effective.set_method(default_method);
  check_method(effective.method());
  engine.order = to_engine(requested.order(), "settings.order");
  if (requested.order() == v1::PROBE_ORDER_UNSPECIFIED) effective.set_order(v1::PROBE_ORDER_BOTH);
  engine.derivatives = to_engine(requested.derivatives());
  if (requested.derivatives() == v1::PROBE_DERIVATIVES_UNSPECIFIED)
    effective.set_derivatives(v1::PROBE_DERIVATIVES_HESSIAN);
  if (requested.has_samples()) engine.samples = requested.samples();
  if (requested.has_repeats()) engine.repeats = requested.repeats();
  engine.max_depth = requested.has_max_depth() ? requested.max_depth() : scene.defaults.max_depth;
  if (requested.has_bisect()) engine.bisect = requested.bisect();
  if (requested.has_sliding()) engine.sliding = requested.sliding();
  if (requested.has_corners()) engine.corners = requested.corners();
  engine.seed = requested.seed();
  try {
    derivatives::validate(engine);
  } catch (const Error& error) {
    const EngineFieldError parts(error);
    refuse_field("settings." + parts.field, parts.message);
  }
  effective.set_samples(engine.samples);
  effective.set_repeats(engine.repeats);
  effective.set_max_depth(engine.max_depth);
  effective.set_bisect(engine.bisect);
  effective.set_sliding(engine.sliding);
  effective.set_corners(engine.corners);
  return resolved;
}

transport::PlanRequest resolve_plan(const v1::GetPlanRequest& requested, const scene::Scene& scene) {
  const Order order = to_engine(requested.order(), "order");
  const int32_t max_depth = requested.has_max_depth() ? requested.max_depth() : scene.defaults.max_depth;
  if (max_depth < -1 || max_depth > derivatives::EstimatorLimits::path_depth) {
    refuse_field("max_depth", std::to_string(max_depth) + " is not in -1 .. " +
                                  std::to_string(derivatives::EstimatorLimits::path_depth));
  }
  return {.from_surfaces = order != Order::multiple,
          .from_medium = order != Order::single,
          .max_depth = max_depth,
          .leave_out = true};
}

}  // namespace fogbank::service
