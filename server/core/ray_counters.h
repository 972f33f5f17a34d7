// How many rays were traced.
#pragma once

#include <cstdint>

namespace fogbank {

/// Counters of one thread; added up when a tile is done.
struct RayCounters {
  uint64_t closest_hit = 0;
  uint64_t any_hit = 0;
  uint64_t total() const { return closest_hit + any_hit; }
};

}  // namespace fogbank
