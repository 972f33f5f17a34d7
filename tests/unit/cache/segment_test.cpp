#include "cache/store/segment.h"

#include <gtest/gtest.h>
#include <xxhash.h>

#include <cstring>

#include "cache/store/bytes.h"
#include "cache/store/chunk.h"
#include "core/error.h"
#include "core/sha256.h"
#include "varied_records.h"

namespace fogbank::cache {
namespace {

using test::same;
using test::varied_records;

const std::string transport = sha256("a scene");

std::vector<SegmentPart> two_parts() {
  std::vector<SegmentPart> parts;
  parts.push_back({{Spectrum(2), Spectrum(1, 0, 3)}, RecordSet(varied_records(300, 1))});
  parts.push_back({{}, RecordSet(varied_records(200, 2))});
  return parts;
}

/// The reason of the Error that opening throws, "" where the bytes are taken for a segment.
std::string reason_of(const std::string& bytes) {
  try {
    open_segment(bytes, "the file");
    return "";
  } catch (const Error& error) {
    EXPECT_TRUE(std::string(error.what()).starts_with("the file: ")) << error.what();
    return error.reason();
  }
}

/// With the checksum of the header and the SHA-256 made right again, as someone who knows the format can.
std::string resealed(std::string bytes) {
  uint32_t header = 0;
  std::memcpy(&header, bytes.data() + 12, sizeof(header));
  if (header >= 8 && header <= bytes.size() - 40) {
    const uint64_t checksum = XXH3_64bits(bytes.data(), header - 8);
    std::memcpy(bytes.data() + header - 8, &checksum, sizeof(checksum));
  }
  const std::string digest = sha256(std::string_view(bytes).substr(0, bytes.size() - 40));
  for (size_t i = 0; i < 32; ++i)
    bytes[bytes.size() - 40 + i] = static_cast<char>(std::stoi(digest.substr(2 * i, 2), nullptr, 16));
  return bytes;
}

TEST(Segment, ReadsBackToTheBit) {
  const std::vector<SegmentPart> parts = two_parts();
  const SealedSegment sealed = seal_segment(transport, parts);
  const Segment segment = open_segment(sealed.bytes, "x");
  EXPECT_EQ(segment.sha256, sealed.sha256);
  EXPECT_EQ(segment.info.transport, transport);
  EXPECT_EQ(segment.info.records, parts[0].records.size() + parts[1].records.size());
  EXPECT_EQ(sealed.records, segment.info.records);
  ASSERT_EQ(segment.parts.size(), 2u);
  EXPECT_TRUE(segment.parts[0].emission.empty());
  EXPECT_EQ(segment.parts[1].emission, parts[0].emission);
  EXPECT_TRUE(same(segment.parts[0].records, parts[1].records));
  EXPECT_TRUE(same(segment.parts[1].records, parts[0].records));
  uint64_t counted = 0;
  for (const ComponentCount& count : segment.info.components) counted += count.records;
  EXPECT_EQ(counted, segment.info.records);
}

TEST(Segment, SameRecordsGiveTheSameBytes) {
  std::vector<SegmentPart> parts = two_parts();
  const SealedSegment sealed = seal_segment(transport, parts);
  std::swap(parts[0], parts[1]);
  EXPECT_EQ(seal_segment(transport, parts).bytes, sealed.bytes);
  // In pieces that overlap, of one emission each.
  const std::vector<Record> records = test::all(parts[0].records);
  std::vector<SegmentPart> pieces;
  pieces.push_back({{}, RecordSet(std::vector<Record>(records.begin() + 50, records.end()))});
  pieces.push_back(parts[1]);
  pieces.push_back({{}, RecordSet(std::vector<Record>(records.begin(), records.begin() + 90))});
  EXPECT_EQ(seal_segment(transport, pieces).bytes, sealed.bytes);
}

TEST(Segment, SeveralChunks) {
  std::vector<Record> records(most_chunk_records + 100);
  RandomStream random(4, 0, 0, 0);
  for (size_t i = 0; i < records.size(); ++i) {
    records[i].position = {random.next_float(), random.next_float(), random.next_float()};
    records[i].id = i;
  }
  const RecordSet set(records);
  const Segment segment = open_segment(seal_segment(transport, {{{}, set}}).bytes, "x");
  ASSERT_EQ(segment.parts.size(), 1u);
  EXPECT_TRUE(same(segment.parts[0].records, set));
}

TEST(Segment, Empty) {
  const Segment segment = open_segment(seal_segment(transport, {}).bytes, "x");
  EXPECT_EQ(segment.info.records, 0u);
  EXPECT_TRUE(segment.parts.empty());
}

TEST(Segment, EveryFlippedBitIsFound) {
  const std::string bytes = seal_segment(transport, {{{}, RecordSet(varied_records(40, 3))}}).bytes;
  // Each bit of the fixed header and the footer, and one in eleven of the rest.
  for (size_t bit = 0; bit < 8 * bytes.size();
       bit += bit < 8 * 100 || bit > 8 * bytes.size() - 400 ? 1 : 11) {
    std::string flipped = bytes;
    flipped[bit / 8] = static_cast<char>(flipped[bit / 8] ^ (1 << bit % 8));
    const std::string reason = reason_of(flipped);
    const bool version = bit >= 64 && bit < 96;
    EXPECT_TRUE(reason == "SEGMENT_DAMAGED" || (version && reason == "SEGMENT_TOO_NEW")) << bit << reason;
  }
}

TEST(Segment, EveryLengthIsFound) {
  const std::string bytes = seal_segment(transport, {{{}, RecordSet(varied_records(40, 3))}}).bytes;
  for (size_t length = 0; length < bytes.size(); length += length < 600 ? 1 : 37)
    EXPECT_EQ(reason_of(bytes.substr(0, length)), "SEGMENT_DAMAGED") << length;
  EXPECT_EQ(reason_of(bytes + "x"), "SEGMENT_DAMAGED");
  EXPECT_EQ(reason_of(bytes + bytes), "SEGMENT_DAMAGED");
}

TEST(Segment, LaterVersionIsNamed) {
  std::string bytes = seal_segment(transport, {}).bytes;
  bytes[8] = static_cast<char>(segment_version + 1);
  EXPECT_EQ(reason_of(resealed(bytes)), "SEGMENT_TOO_NEW");
}

TEST(Segment, VersionIsTheOldestThatHasItsQuantities) {
  Record record;
  EXPECT_EQ(seal_segment(transport, {{{}, RecordSet({record})}}).bytes[8], 1);
  record.component.quantity = Quantity::directional_rest;
  std::string bytes = seal_segment(transport, {{{}, RecordSet({record})}}).bytes;
  EXPECT_EQ(bytes[8], 2);
  bytes[8] = 1;
  EXPECT_EQ(reason_of(resealed(bytes)), "SEGMENT_DAMAGED");
}

TEST(Segment, LiesWithRightChecksumsAreHarmless) {
  // Header fields of any value: refused, or read as some valid records; lengths never lead beyond the file.
  const std::string bytes =
      seal_segment(transport, {{{Spectrum(1)}, RecordSet(varied_records(30, 5))}}).bytes;
  uint32_t header = 0;
  std::memcpy(&header, bytes.data() + 12, sizeof(header));
  for (size_t at = 12; at < header - 8; at += at < 150 ? 1 : 13)
    for (const uint32_t lie : {0u, 1u, 0x7fffffffu, 0xffffffffu, 0x01000000u}) {
      std::string wrong = bytes;
      std::memcpy(wrong.data() + at, &lie, at % 4 == 0 ? 4 : 1);
      wrong = resealed(wrong);
      const std::string reason = reason_of(wrong);
      EXPECT_TRUE(reason.empty() || reason == "SEGMENT_DAMAGED") << at << " " << lie << " " << reason;
    }
}

TEST(Segment, AFewBytesDoNotStandForManyRecords) {
  // Half a gigabyte of records in a file of 10 kB: what someone would send to fill the memory.
  constexpr uint32_t chunks = 130;
  const std::string sealed = seal_segment(transport, {{{}, RecordSet({Record()})}}).bytes;
  uint32_t header = 0;
  std::memcpy(&header, sealed.data() + 12, sizeof(header));
  const std::string entry = sealed.substr(header - 8 - 28, 28);
  std::string bytes = sealed.substr(0, header - 8 - 28);
  for (uint32_t i = 0; i < chunks; ++i) {
    const size_t at = bytes.size() + 12;  // medium, light group, order, quantity, emission
    bytes += entry;
    std::memcpy(bytes.data() + at, &most_chunk_records, sizeof(most_chunk_records));
  }
  const uint64_t records = uint64_t{chunks} * most_chunk_records;
  std::memcpy(bytes.data() + 48, &records, sizeof(records));
  std::memcpy(bytes.data() + 60, &chunks, sizeof(chunks));
  const auto header_bytes = static_cast<uint32_t>(bytes.size() + 8);
  std::memcpy(bytes.data() + 12, &header_bytes, sizeof(header_bytes));
  append_bytes(bytes, uint64_t{0});
  for (uint32_t i = 0; i < chunks; ++i) bytes += sealed.substr(header, sealed.size() - header - 40);
  bytes = resealed(bytes + sealed.substr(sealed.size() - 40));
  try {
    open_segment(bytes, "the file");
    FAIL();
  } catch (const Error& error) {
    EXPECT_STREQ(error.what(), "the file: a chunk claims more records than it can hold");
  }
}

TEST(Segment, RecordsThatAreNoRecordsAreRefused) {
  // An id more than numbers say is a record with other bytes; what validate() refuses is damage.
  Record record;
  record.radiance = Spectrum(1);
  const std::string good = pack_chunk(RecordSet({record}), 0, 1);
  std::vector<Record> unpacked(1);
  ASSERT_TRUE(unpack_chunk(good, {}, unpacked));
  EXPECT_FALSE(unpack_chunk(good.substr(1), {}, unpacked));
  std::vector<Record> more(2);
  EXPECT_FALSE(unpack_chunk(good, {}, more));
  Component other;
  other.quantity = Quantity::ratio;
  EXPECT_FALSE(unpack_chunk(good, other, unpacked));
}

}  // namespace
}  // namespace fogbank::cache
