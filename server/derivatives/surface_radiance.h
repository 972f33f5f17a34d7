// Radiance that surfaces send towards a record's point because they reflect or refract light: sampled with a
// budget that is shared out over the hits of a direction grid.
#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "derivatives/source.h"
#include "transport/world.h"

namespace fogbank::derivatives {

/// Samples for each hit, `budget` altogether as near as can be: one for every hit that counts, the rest in
/// proportion to importance times the BSDF's mean reflectance, rounded by passing the remainder on to the
/// next hit. The grid's order keeps neighbours together, so the remainder stays where it arose.
std::vector<int32_t> share_out(const transport::World& world, std::span<const SurfaceHit> hits,
                               int32_t budget);

/// Unbiased mean of the samples of every hit: light scattered towards the point, emission left out (it
/// counts in the lights' own grids). Linear sRGB, finite, >= 0.
std::vector<Spectrum> surface_radiance(const transport::World& world, const SurfaceSource& source,
                                       std::span<const SurfaceHit> hits, int32_t budget, RandomStream& random,
                                       RayCounters& counters);

/// The 8 neighbours of each vertex of a direction grid; symmetric: i is a neighbour of j as often as j of i.
using GridNeighbours = std::vector<std::array<uint32_t, 8>>;

/// Radiance smoothed for derivatives, where single noisy vertices of slanted triangles tell (method.md
/// section 15, "Noise"): mean over a vertex and those of its neighbours that lie on the same surface
/// (`surfaces` equal), the vertex itself taking the share of those that don't. The weights are symmetric, so
/// the sum over a surface's vertices, and with it the mean over the grid, stays what it was. A median of
/// three means of three would be 10 to 18 % too low (walls of shafts, statues and classroom in fog, one path
/// a sample), for path-traced radiance is skewed, and less noisy only in the classroom. For derivatives only:
/// values come from unfiltered samples. All spans have the same length.
std::vector<Spectrum> filter_over_neighbours(std::span<const Spectrum> radiance,
                                             const GridNeighbours& neighbours,
                                             std::span<const uint32_t> surfaces);

}  // namespace fogbank::derivatives
