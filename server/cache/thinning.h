// Which of many places that want a record get one: no two of a round overlap needlessly.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "cache/record_maker.h"

namespace fogbank::cache {

/// Numbers of the wishes, all of one component, to be granted, ascending: greedily in the order of a hash of
/// the position, each unless one granted before is nearer than the nearest of `existing` is, or than
/// `greatest_spacing`. So the spacing halves from round to round where look-ups keep missing, and the result
/// depends on the wishes as a set, not on their order. `seed` selects the hash. At most `most` are granted.
std::vector<uint32_t> thin(std::span<const Wish> wishes, std::span<const Wish> existing,
                           float greatest_spacing, uint64_t seed, size_t most);

}  // namespace fogbank::cache
