// Some thousand records of a component, compressed by column: one zstd frame of, for n records,
//
//   id (uint64); position x, y, z; radiance r, g, b; gradient of r by x, y, z, of g, of b; Hessian xx, xy,
//   xz, yy, yz, zz; variance (float32 each); samples (uint32); what is particular to the quantity, if there
//   is (uint32, record.h); visibility margin (uint16, record.h); the 64 depth bins (uint8 each); where
//   has_shape(), the shape's exponent and its 31 numbers (int8 each, directional_shape.h)
//
// n values one after the other of each, first their lowest bytes, then the next: signs and exponents of
// neighbours along the set's curve are alike, and find each other.
#pragma once

#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "cache/record_set.h"

namespace fogbank::cache {

inline constexpr uint32_t most_chunk_records = 16384;

/// Records first to first + count of `set`, all of one component; count is at most most_chunk_records.
std::string pack_chunk(const RecordSet& set, size_t first, size_t count);

/// False if `payload` isn't a chunk of records.size() records; theirs is the component given then.
bool unpack_chunk(std::string_view payload, const Component& component, std::span<Record> records);

}  // namespace fogbank::cache
