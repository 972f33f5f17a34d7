#include "cache/store/segment.h"

#include <tbb/parallel_for.h>
#include <tbb/parallel_invoke.h>
#include <xxhash.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <span>

#include "cache/store/bytes.h"
#include "cache/store/chunk.h"
#include "core/error.h"
#include "core/sha256.h"

namespace fogbank::cache {
namespace {

constexpr std::string_view magic = "FOGCACHE";
constexpr std::string_view seal = "FOGCSEAL";
constexpr size_t hash_bytes = 32;
constexpr size_t fixed_header_bytes = 8 + 4 + 4 + hash_bytes + 8 + 4 + 4;
constexpr size_t chunk_entry_bytes = 4 + 2 + 1 + 1 + 4 + 4 + 4 + 8;
constexpr size_t footer_bytes = hash_bytes + 8;
/// Compressed, a record takes at least this: nothing compresses the 8 bytes of its id, which is a hash.
/// Except among so few that it doesn't matter. Else a small file could stand for more records than there is
/// memory.
constexpr uint32_t least_record_bytes = 4;
constexpr uint32_t few_records = 256;

struct ChunkEntry {
  Component component;
  uint32_t emission = 0;
  uint32_t records = 0;
  uint32_t bytes = 0;
  uint64_t checksum = 0;
};

struct Header {
  std::string transport;
  uint64_t records = 0;
  std::vector<std::vector<Spectrum>> emissions;
  std::vector<ChunkEntry> chunks;
  size_t bytes = 0;
};

[[noreturn]] void damaged(const std::string& file, const std::string& what) {
  throw Error(ErrorKind::data_loss, "SEGMENT_DAMAGED", file + ": " + what);
}

std::string to_raw(const std::string& hexadecimal) {
  std::string raw;
  for (size_t i = 0; i + 1 < hexadecimal.size(); i += 2)
    raw += static_cast<char>(std::stoi(hexadecimal.substr(i, 2), nullptr, 16));
  return raw;
}

std::string to_hexadecimal(std::string_view raw) {
  constexpr std::string_view digits = "0123456789abcdef";
  std::string text;
  for (const char c : raw) {
    text += digits[static_cast<unsigned char>(c) >> 4];
    text += digits[static_cast<unsigned char>(c) & 15u];
  }
  return text;
}

/// The oldest version that has the quantity.
uint32_t version_of(Quantity quantity) { return has_shape(quantity) ? 2 : 1; }

uint64_t checksum(std::string_view bytes) { return XXH3_64bits(bytes.data(), bytes.size()); }

bool darker(const std::vector<Spectrum>& a, const std::vector<Spectrum>& b) {
  return std::lexicographical_compare(
      a.begin(), a.end(), b.begin(), b.end(), [](const Spectrum& one, const Spectrum& other) {
        return std::array{one.x, one.y, one.z} < std::array{other.x, other.y, other.z};
      });
}

/// Header of a file of `size` bytes that begins with `bytes`.
Header read_header(std::string_view bytes, uint64_t size, const std::string& file) {
  ByteReader reader(bytes);
  if (reader.take(magic.size()) != magic) damaged(file, "doesn't begin as a segment of a cache does");
  const auto version = reader.take<uint32_t>();
  if (reader.ok() && version > segment_version)
    throw Error(ErrorKind::failed_precondition, "SEGMENT_TOO_NEW",
                file + ": written by a newer version of Fogbank (format " + std::to_string(version) +
                    "; this one reads up to " + std::to_string(segment_version) + ")");
  Header header;
  header.bytes = reader.take<uint32_t>();
  header.transport = to_hexadecimal(reader.take(hash_bytes));
  header.records = reader.take<uint64_t>();
  const auto emissions = reader.take<uint32_t>();
  const auto chunks = reader.take<uint32_t>();
  if (!reader.ok() || version == 0 || header.bytes < fixed_header_bytes + 8 || header.bytes > bytes.size())
    damaged(file, "its header is damaged or cut off");
  if (checksum(bytes.substr(0, header.bytes - 8)) !=
      ByteReader(bytes.substr(header.bytes - 8)).take<uint64_t>())
    damaged(file, "the checksum of its header is wrong");

  // From here on lengths are what was written, but nobody vouches for the writer.
  for (uint32_t i = 0; i < emissions; ++i) {
    const auto emitters = reader.take<uint32_t>();
    if (!reader.ok() || emitters > reader.left() / sizeof(Spectrum)) damaged(file, "bad table of emissions");
    std::vector<Spectrum>& emission = header.emissions.emplace_back(emitters);
    for (Spectrum& scale : emission) scale = reader.take<Spectrum>();
    if (i > 0 && !darker(header.emissions[i - 1], emission)) damaged(file, "emissions aren't in order");
  }
  if (chunks > reader.left() / chunk_entry_bytes) damaged(file, "bad table of chunks");
  uint64_t records = 0;
  uint64_t total = header.bytes + footer_bytes;
  for (uint32_t i = 0; i < chunks; ++i) {
    ChunkEntry& chunk = header.chunks.emplace_back();
    chunk.component.medium = reader.take<int32_t>();
    chunk.component.light_group = reader.take<uint16_t>();
    chunk.component.scattering_order = reader.take<uint8_t>();
    chunk.component.quantity = static_cast<Quantity>(reader.take<uint8_t>());
    chunk.emission = reader.take<uint32_t>();
    chunk.records = reader.take<uint32_t>();
    chunk.bytes = reader.take<uint32_t>();
    chunk.checksum = reader.take<uint64_t>();
    if (chunk.component.quantity > last_quantity || version_of(chunk.component.quantity) > version ||
        chunk.emission >= emissions || chunk.records == 0 || chunk.records > most_chunk_records)
      damaged(file, "bad table of chunks");
    if (chunk.records > few_records && chunk.bytes / least_record_bytes < chunk.records)
      damaged(file, "a chunk claims more records than it can hold");
    records += chunk.records;
    total += chunk.bytes;
  }
  if (!reader.ok() || reader.position() + 8 != header.bytes || records != header.records)
    damaged(file, "its header contradicts itself");
  if (total != size) damaged(file, std::to_string(size) + " bytes long instead of " + std::to_string(total));
  return header;
}

SegmentInfo info_of(const Header& header) {
  SegmentInfo info{header.transport, header.records, header.emissions.size(), {}};
  for (const ChunkEntry& chunk : header.chunks) {
    const auto at =
        std::ranges::lower_bound(info.components, chunk.component, {}, &ComponentCount::component);
    if (at != info.components.end() && at->component == chunk.component)
      at->records += chunk.records;
    else
      info.components.insert(at, {chunk.component, chunk.records});
  }
  return info;
}

}  // namespace

std::vector<SegmentPart> unite(std::vector<SegmentPart> a, std::vector<SegmentPart> b) {
  for (SegmentPart& part : b) a.push_back(std::move(part));
  std::ranges::stable_sort(a, darker, &SegmentPart::emission);
  std::vector<SegmentPart> result;
  for (SegmentPart& part : a) {
    if (part.records.size() == 0) continue;
    if (!result.empty() && result.back().emission == part.emission)
      result.back().records = merge(result.back().records, part.records);
    else
      result.push_back(std::move(part));
  }
  return result;
}

SealedSegment seal_segment(const std::string& transport, const std::vector<SegmentPart>& unsorted) {
  const std::vector<SegmentPart> parts = unite(unsorted, {});
  std::vector<ChunkEntry> chunks;
  std::vector<size_t> firsts;
  SealedSegment sealed;
  for (uint32_t emission = 0; emission < parts.size(); ++emission) {
    sealed.records += parts[emission].records.size();
    for (const ComponentRange& range : parts[emission].records.components())
      for (size_t first = 0; first < range.record_count; first += most_chunk_records) {
        const size_t count = std::min<size_t>(most_chunk_records, range.record_count - first);
        chunks.push_back({range.component, emission, static_cast<uint32_t>(count), 0, 0});
        firsts.push_back(range.first_record + first);
      }
  }
  std::vector<std::string> payloads(chunks.size());
  tbb::parallel_for(size_t{0}, chunks.size(), [&](size_t i) {
    payloads[i] = pack_chunk(parts[chunks[i].emission].records, firsts[i], chunks[i].records);
    chunks[i].bytes = static_cast<uint32_t>(payloads[i].size());
    chunks[i].checksum = checksum(payloads[i]);
  });

  std::string tables;
  for (const SegmentPart& part : parts) {
    append_bytes(tables, static_cast<uint32_t>(part.emission.size()));
    for (const Spectrum& scale : part.emission) append_bytes(tables, scale);
  }
  size_t total = footer_bytes;
  for (const ChunkEntry& chunk : chunks) {
    append_bytes(tables, chunk.component.medium);
    append_bytes(tables, chunk.component.light_group);
    append_bytes(tables, chunk.component.scattering_order);
    append_bytes(tables, static_cast<uint8_t>(chunk.component.quantity));
    append_bytes(tables, chunk.emission);
    append_bytes(tables, chunk.records);
    append_bytes(tables, chunk.bytes);
    append_bytes(tables, chunk.checksum);
    total += chunk.bytes;
  }
  const size_t header_bytes = fixed_header_bytes + tables.size() + sizeof(uint64_t);
  std::string& bytes = sealed.bytes;
  bytes.reserve(header_bytes + total);
  bytes += magic;
  uint32_t version = 1;
  for (const ChunkEntry& chunk : chunks) version = std::max(version, version_of(chunk.component.quantity));
  append_bytes(bytes, version);
  append_bytes(bytes, static_cast<uint32_t>(header_bytes));
  bytes += to_raw(transport);
  append_bytes(bytes, sealed.records);
  append_bytes(bytes, static_cast<uint32_t>(parts.size()));
  append_bytes(bytes, static_cast<uint32_t>(chunks.size()));
  bytes += tables;
  append_bytes(bytes, checksum(bytes));
  for (const std::string& payload : payloads) bytes += payload;
  sealed.sha256 = sha256(bytes);
  bytes += to_raw(sealed.sha256);
  bytes += seal;
  return sealed;
}

SegmentInfo read_segment_info(std::string_view bytes, uint64_t size, const std::string& file) {
  return info_of(read_header(bytes, size, file));
}

Segment open_segment(std::string_view bytes, const std::string& file) {
  const Header header = read_header(bytes, bytes.size(), file);
  if (!bytes.ends_with(seal)) damaged(file, "its end is damaged");
  Segment segment{info_of(header), {}, {}};
  std::vector<std::vector<Record>> records(header.emissions.size());
  struct Offset {
    size_t first_record = 0;
    size_t first_byte = 0;
  };
  std::vector<Offset> places;
  size_t byte = header.bytes;
  std::vector<size_t> counts(header.emissions.size());
  for (const ChunkEntry& chunk : header.chunks) {
    places.push_back({counts[chunk.emission], byte});
    counts[chunk.emission] += chunk.records;
    byte += chunk.bytes;
  }
  std::atomic<size_t> bad = header.chunks.size();
  const auto unpack = [&](size_t i) {
    const ChunkEntry& chunk = header.chunks[i];
    const std::string_view payload = bytes.substr(places[i].first_byte, chunk.bytes);
    const std::span target =
        std::span(records[chunk.emission]).subspan(places[i].first_record, chunk.records);
    if (checksum(payload) != chunk.checksum || !unpack_chunk(payload, chunk.component, target)) bad = i;
  };
  tbb::parallel_invoke([&] { segment.sha256 = sha256(bytes.substr(0, bytes.size() - footer_bytes)); },
                       [&] {
                         for (size_t i = 0; i < records.size(); ++i) records[i].resize(counts[i]);
                         tbb::parallel_for(size_t{0}, header.chunks.size(), unpack);
                       });
  if (bad < header.chunks.size()) damaged(file, "chunk " + std::to_string(bad) + " is damaged");
  if (to_raw(segment.sha256) != bytes.substr(bytes.size() - footer_bytes, hash_bytes))
    damaged(file, "its SHA-256 is wrong");
  for (size_t i = 0; i < records.size(); ++i) {
    try {
      segment.parts.push_back({header.emissions[i], RecordSet(std::move(records[i]))});
    } catch (const Error& error) {
      damaged(file, error.what());
    }
  }
  return segment;
}

}  // namespace fogbank::cache
