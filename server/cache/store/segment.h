// Sealed sets of records as bytes: what a store keeps in files, and what exports are. Immutable and named by
// what they hold, so that they can be copied between machines and come to the same wherever they are read.
//
// Little-endian, without padding:
//
//   header   "FOGCACHE"; uint32 version (2 where a component has_shape(), else 1); uint32 bytes of the
//   header, all of it; 32 bytes transport
//            fingerprint; uint64 records; uint32 emissions; uint32 chunks;
//            for each emission: uint32 emitters, and 3 float32 each (linear sRGB);
//            for each chunk: int32 medium, uint16 light group, uint8 scattering order, uint8 quantity, uint32
//            emission, uint32 records, uint32 bytes of its payload, uint64 XXH3 of its payload;
//            uint64 XXH3 of the header up to here
//   payloads of the chunks, in that order (chunk.h)
//   footer   32 bytes SHA-256 of all before; "FOGCSEAL"
#pragma once

#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

#include "cache/record_set.h"

namespace fogbank::cache {

/// The newest that is read and written.
inline constexpr uint32_t segment_version = 2;

/// Records made under one emission (scene::FieldIdentity::emission); no emission where records don't depend
/// on it.
struct SegmentPart {
  std::vector<Spectrum> emission;
  RecordSet records;
};

struct ComponentCount {
  Component component;
  uint64_t records = 0;
};

/// What a header says.
struct SegmentInfo {
  std::string transport;  ///< 64 hexadecimal digits
  uint64_t records = 0;
  uint64_t emissions = 0;                  ///< different ones
  std::vector<ComponentCount> components;  ///< ascending, over all emissions
};

struct Segment {
  SegmentInfo info;
  std::string sha256;              ///< 64 hexadecimal digits: its name
  std::vector<SegmentPart> parts;  ///< ascending by emission, each emission once
};

/// The bytes of a segment and their name. `parts` in any order; those of the same emission are united. The
/// same sets give the same bytes.
struct SealedSegment {
  std::string sha256;
  std::string bytes;
  uint64_t records = 0;
};
SealedSegment seal_segment(const std::string& transport, const std::vector<SegmentPart>& parts);

/// Throws Error(data_loss, "SEGMENT_DAMAGED") unless every byte is as it was sealed, and
/// Error(failed_precondition, "SEGMENT_TOO_NEW") for a later version; messages begin with `file` and a colon.
Segment open_segment(std::string_view bytes, const std::string& file);
/// The header alone: of the first bytes of a file, `size` bytes long in all. Throws as open_segment; also
/// when `bytes` end before the header does.
SegmentInfo read_segment_info(std::string_view bytes, uint64_t size, const std::string& file);

/// Parts of `a` and `b` with the records of the same emission united; ascending by emission.
std::vector<SegmentPart> unite(std::vector<SegmentPart> a, std::vector<SegmentPart> b);

}  // namespace fogbank::cache
