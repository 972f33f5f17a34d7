// Results of points in their wire form.
#pragma once

#include <cstdint>
#include <span>

#include "derivatives/estimator.h"
#include "fogbank/v1/probe.pb.h"
#include "render/probe_job.h"

namespace fogbank::service {

/// Replaces what `message` held. `first_point` is the number of the first of them in the stream; derivatives
/// that weren't computed are left out.
void set_results(v1::ProbeResults& message, uint64_t first_point,
                 std::span<const render::PointResult> results, derivatives::DerivativeOrder derivatives);

}  // namespace fogbank::service
