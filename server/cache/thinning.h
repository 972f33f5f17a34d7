// Which of many places that want a record get one: no two of a round overlap needlessly.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "cache/record_maker.h"

namespace fogbank::cache {

/// A wish and the distance within which no other record of the round is needed: what its extent is thought to
/// be, somewhat less. > 0.
struct SpacedWish {
  Wish wish;
  float spacing = 0;
};

/// Numbers of the wishes to be granted: greedily in the order of a hash of the position, each unless one of
/// the same component (and a similar normal) granted before is nearer than that one's spacing. So every wish
/// that is refused has a granted one in reach, the result depends on the wishes as a set, not on their order,
/// and whoever gets no farther than its first part has served all places alike. `seed` selects the hash. At
/// most `most` are granted.
std::vector<uint32_t> thin(std::span<const SpacedWish> wishes, uint64_t seed, size_t most);

}  // namespace fogbank::cache
