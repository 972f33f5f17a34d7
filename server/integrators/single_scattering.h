// Light that is scattered exactly once between an emitter and a segment's origin: the part of a picture that
// has techniques of its own (ratio-records.md).
#pragma once

#include <memory>
#include <vector>

#include "cache/index.h"
#include "cache/record_maker.h"
#include "integrators/integrator.h"
#include "transport/medium_segment.h"
#include "transport/world.h"

namespace fogbank::integrators {

/// Immutable; one instance serves all threads.
class SingleScatteringTerm {
 public:
  explicit SingleScatteringTerm(std::shared_ptr<const transport::World> world) : world_(std::move(world)) {}

  /// Radiance scattered once in `segment`, through `medium`, against its direction, with the transmittance up
  /// to its origin; one sample of it. `epoch` may be null.
  PixelSample sample(const transport::MediumSegment& segment, int32_t medium, const cache::Epoch* epoch,
                     RandomStream& random, RayCounters& counters) const;
  /// Adds the places of `segment` that `sample` would look up and that no record reaches.
  void find_uncovered(const transport::MediumSegment& segment, int32_t medium, const cache::Epoch* epoch,
                      std::vector<cache::Wish>& uncovered) const;

 private:
  std::shared_ptr<const transport::World> world_;
};

}  // namespace fogbank::integrators
