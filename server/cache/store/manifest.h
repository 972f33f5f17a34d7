// The list of a cache's segments: a text file, the last to be written, so that what it names is on the disk.
//
//   fogbank cache 1
//   transport <64 hexadecimal digits>
//   epoch <number>
//   segment <SHA-256> <bytes> <records> <epoch> <seconds since 1970>
//   ...
//   checksum <XXH3 of all lines above, 16 hexadecimal digits>
#pragma once

#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

namespace fogbank::cache {

struct SegmentEntry {
  std::string sha256;
  uint64_t bytes = 0;
  uint64_t records = 0;
  uint64_t epoch = 0;     ///< that it came with
  int64_t sealed_at = 0;  ///< seconds since 1970
};

struct Manifest {
  std::string transport;
  uint64_t epoch = 0;  ///< goes up with every change
  std::vector<SegmentEntry> segments;

  bool names(const std::string& sha256) const;
};

std::string to_text(const Manifest& manifest);
/// Throws Error(data_loss, "MANIFEST_DAMAGED"), or Error(failed_precondition, "CACHE_TOO_NEW") for a later
/// version; messages begin with `file` and a colon.
Manifest parse_manifest(std::string_view text, const std::string& file);

/// 64 lower-case hexadecimal digits?
bool is_sha256(std::string_view text);

}  // namespace fogbank::cache
