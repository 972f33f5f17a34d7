// How far a record of a ratio may be trusted: what stands around the line of sight to the light.
#pragma once

#include <span>

#include "cache/record.h"
#include "core/ray_counters.h"
#include "transport/world.h"

namespace fogbank::cache {

enum class Sight : uint8_t { lit, penumbra, umbra };

/// Distance from `x` to the nearest place where a light stops being visible as a whole (`lit`) or begins to
/// be visible at all (`umbra`), as far as about 500 rays tell, outlines bisected; infinity in penumbrae and
/// where nothing is met. The light is given by points on it, relative to `x`. Distances to surfaces are
/// entered into `depth`.
float visibility_margin(const transport::World& world, const Vec3f& x, std::span<const Vec3d> light,
                        Sight sight, DepthBins& depth, RayCounters& counters);

}  // namespace fogbank::cache
