// Wishes and records one by one as bytes, for processes of the same build that share work. Files hold
// segments instead (store/segment.h).
#pragma once

#include <optional>
#include <string>

#include "cache/record_maker.h"
#include "cache/store/bytes.h"
#include "cache/thinning.h"

namespace fogbank::cache {

inline constexpr size_t component_bytes = 8;
inline constexpr size_t wish_bytes = 24 + component_bytes;
inline constexpr size_t spaced_wish_bytes = wish_bytes + 4;
/// Without a shape.
inline constexpr size_t record_bytes = 20 + component_bytes + 4 * 25 + DepthBins::count;

void append_component(std::string& bytes, const Component& component);
void append_wish(std::string& bytes, const Wish& wish);
void append_wish(std::string& bytes, const SpacedWish& wish);
/// Every bit as it is.
void append_record(std::string& bytes, const Record& record);
/// Whether there is one, and the record.
void append_record(std::string& bytes, const std::optional<Record>& record);

// These throw Error(invalid_argument, "POISONED_RESULT") where the bytes end too soon or a number is out of
// range. Whether the scene has such a medium or light is for the caller to see.

Component take_component(ByteReader& bytes);
Wish take_wish(ByteReader& bytes);
SpacedWish take_spaced_wish(ByteReader& bytes);
Record take_record(ByteReader& bytes);
std::optional<Record> take_optional_record(ByteReader& bytes);
/// Number of elements of at least `smallest` bytes each: what is left holds as many.
uint32_t take_count(ByteReader& bytes, size_t smallest);
/// That nothing is left.
void expect_end(const ByteReader& bytes);

[[noreturn]] void refuse_poisoned(const std::string& why);

}  // namespace fogbank::cache
