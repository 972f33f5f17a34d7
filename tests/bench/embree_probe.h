// What embree_probe.cpp, preloaded into a process, counts.
#pragma once

#include <cstdint>

namespace fogbank {

struct EmbreeProbe {
  uint64_t rays = 0;           ///< rtcIntersect1 and rtcOccluded1
  double seconds = 0;          ///< wall time in them, summed over threads, the clock's own time taken off
  uint64_t replayed_rays = 0;  ///< the same rays once more, in a loop that does nothing else
  double replay_seconds = 0;
};

/// Counts since the last call; no thread may be in Embree meanwhile.
using EmbreeProbeTake = void(EmbreeProbe* taken);
inline constexpr const char* embree_probe_take_name = "fogbank_embree_probe_take";

}  // namespace fogbank
