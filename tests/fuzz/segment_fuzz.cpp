// Segments of caches: as they are, resealed as someone who knows the format would, and the input as the
// columns that a chunk holds compressed, since hardly any change of a compressed stream gets past zstd.
#include <xxhash.h>
#include <zstd.h>

#include <cstring>
#include <vector>

#include "cache/store/chunk.h"
#include "cache/store/segment.h"
#include "core/sha256.h"
#include "fuzz.h"

using namespace fogbank;

namespace {

constexpr size_t footer_bytes = 40;

/// A segment is refused, or reads back the same however often it is written.
void check(const std::string& bytes) {
  cache::Segment segment;
  if (!fuzz::accepts([&] { segment = cache::open_segment(bytes, "segment"); })) return;
  const cache::SealedSegment sealed = cache::seal_segment(segment.info.transport, segment.parts);
  const cache::Segment again = cache::open_segment(sealed.bytes, "segment");
  fuzz::require(cache::seal_segment(again.info.transport, again.parts).bytes == sealed.bytes,
                "it reads back the same");
}

/// With checksum of the header and SHA-256 made right.
std::string resealed(std::string bytes) {
  if (bytes.size() < 72 + footer_bytes) return bytes;
  uint32_t header = 0;
  std::memcpy(&header, bytes.data() + 12, sizeof header);
  if (header >= 8 && header <= bytes.size() - footer_bytes) {
    const uint64_t checksum = XXH3_64bits(bytes.data(), header - 8);
    std::memcpy(bytes.data() + header - 8, &checksum, sizeof checksum);
  }
  const std::string digest = sha256(std::string_view(bytes).substr(0, bytes.size() - footer_bytes));
  for (size_t i = 0; i < 32; ++i)
    bytes[bytes.size() - footer_bytes + i] =
        static_cast<char>(std::stoi(digest.substr(2 * i, 2), nullptr, 16));
  return bytes;
}

void check_columns(const std::string& bytes) {
  constexpr size_t component_bytes = 3;
  if (bytes.size() < component_bytes) return;
  const auto byte = [&](size_t i) { return static_cast<uint8_t>(bytes[i]); };
  const cache::Component component{static_cast<int8_t>(byte(0)), byte(1), 1,
                                   static_cast<cache::Quantity>(byte(2) % 6)};
  const size_t record_bytes = 166 + (cache::has_particular(component.quantity) ? 4 : 0) +
                              (cache::has_shape(component.quantity) ? 32 : 0);  // chunk.h
  const size_t count = (bytes.size() - component_bytes) / record_bytes;
  if (count == 0 || count > cache::most_chunk_records) return;
  std::string payload(ZSTD_compressBound(bytes.size()), '\0');
  payload.resize(
      ZSTD_compress(payload.data(), payload.size(), bytes.data() + component_bytes, count * record_bytes, 1));
  std::vector<cache::Record> records(count);
  fuzz::require(cache::unpack_chunk(payload, component, records), "columns of the right size are records");
  cache::RecordSet set;
  if (!fuzz::accepts([&] { set = cache::RecordSet(std::move(records)); })) return;
  const std::string sealed = cache::seal_segment(sha256("a scene"), {{{}, set}}).bytes;
  fuzz::require(cache::open_segment(sealed, "segment").parts.size() == 1, "what was sealed opens");
  check(sealed);
}

}  // namespace

int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size) {
  const std::string bytes = fuzz::bytes_of(data, size);
  check(bytes);
  check(resealed(bytes));
  check_columns(bytes);
  return 0;
}
