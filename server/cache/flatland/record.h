// A record of the two-dimensional cache: what record.h holds in space, where every step can be seen and the
// exact answer is known.
#pragma once

#include <limits>

#include "cache/flatland/surroundings.h"
#include "derivatives/jet.h"

namespace fogbank::cache::flatland {

struct Record {
  Vec2d position{0};
  derivatives::Jet2d mean;  ///< mean radiance, >= 0, with gradient and Hessian
  /// sum |L_i| / sum |grad L_i| over the samples, in units: length in which the radiance changes by as much
  /// as itself if all samples change alike. Infinite where nothing changes; only Metric::first_order asks.
  double change_length = std::numeric_limits<double>::infinity();
  Surroundings surroundings;
};

}  // namespace fogbank::cache::flatland
