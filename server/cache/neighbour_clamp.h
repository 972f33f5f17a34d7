// Guard 1 of method.md section 10.4: radii that don't outrun those of their neighbours.
#pragma once

#include <span>
#include <vector>

#include "cache/packet.h"
#include "core/vector.h"

namespace fogbank::cache {

/// min over j of (radii[j] + |x_i - x_j|) for each i, j = i included: the greatest function below `radii`
/// that changes by no more than the distance (Krivanek et al. 2006, "Making Radiance and Irradiance Caching
/// Practical", neighbour clamping). One pass over unclamped radii is the fixed point, so the result is a
/// function of the set. `positions` lie along a space-filling curve; nearly linear time for radii that are
/// nearly smooth.
std::vector<float> neighbour_clamp(std::span<const PositionPacket> positions,
                                   const std::vector<float>& radii);

}  // namespace fogbank::cache
