#include "service/probe_messages.h"

namespace fogbank::service {

using derivatives::DerivativeOrder;
using derivatives::Jet3d;
using derivatives::RadianceJet;

namespace {

using Numbers = google::protobuf::RepeatedField<double>;

/// Appends a jet's numbers, as far as they were computed.
void append(const Jet3d& jet, DerivativeOrder derivatives, Numbers& values, Numbers& gradients,
            Numbers& hessians) {
  values.Add(jet.value);
  if (derivatives == DerivativeOrder::value) return;
  for (int i = 0; i < 3; ++i) gradients.Add(jet.gradient[i]);
  if (derivatives == DerivativeOrder::gradient) return;
  hessians.Add(jet.hessian.entries.begin(), jet.hessian.entries.end());
}

void append(const RadianceJet& radiance, const Jet3d& luminance, DerivativeOrder derivatives,
            v1::ProbeField& field) {
  for (const Jet3d& channel : radiance.channels) {
    append(channel, derivatives, *field.mutable_radiance(), *field.mutable_gradient(),
           *field.mutable_hessian());
  }
  append(luminance, derivatives, *field.mutable_luminance(), *field.mutable_luminance_gradient(),
         *field.mutable_luminance_hessian());
}

}  // namespace

void set_results(v1::ProbeResults& message, uint64_t first_point,
                 std::span<const render::PointResult> results, DerivativeOrder derivatives) {
  message.Clear();
  message.set_first_point(first_point);
  for (const render::PointResult& result : results) {
    const derivatives::PointEstimate& estimate = result.estimate;
    append(estimate.mean, estimate.mean.luminance(), derivatives, *message.mutable_mean());
    append(estimate.standard_error, estimate.luminance_standard_error, derivatives,
           *message.mutable_standard_error());
    message.add_samples(estimate.samples);
    message.add_seconds(estimate.seconds);
    message.add_medium_index(result.medium);
  }
}

}  // namespace fogbank::service
