#include "integrators/single_scattering.h"

#include "transport/direct_light_bundle.h"

namespace fogbank::integrators {

namespace {

/// Samples along one segment.
constexpr int32_t direct_samples = 4;

}  // namespace

PixelSample SingleScatteringTerm::sample(const transport::MediumSegment& segment, int32_t medium,
                                         const cache::Epoch* /*epoch*/, RandomStream& random,
                                         RayCounters& counters) const {
  return {.sampled = transport::in_scattered_radiance_bundle(*world_, segment, medium, direct_samples, random,
                                                             counters)};
}

void SingleScatteringTerm::find_uncovered(const transport::MediumSegment& /*segment*/, int32_t /*medium*/,
                                          const cache::Epoch* /*epoch*/,
                                          std::vector<cache::Wish>& /*uncovered*/) const {}

}  // namespace fogbank::integrators
