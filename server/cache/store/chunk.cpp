#include "cache/store/chunk.h"

#include <zstd.h>

#include <algorithm>
#include <array>
#include <cstring>

#include "core/error.h"

namespace fogbank::cache {
namespace {

/// Fast, and columns leave little for slower levels to find (README of the benchmarks: `make bench`).
constexpr int compression_level = 1;

size_t raw_bytes(Quantity quantity, size_t count) {
  constexpr size_t common =
      sizeof(uint64_t) + 22 * sizeof(float) + sizeof(uint32_t) + sizeof(uint16_t) + DepthBins::count;
  return count * (common + (has_particular(quantity) ? sizeof(uint32_t) : 0) +
                  (has_shape(quantity) ? sizeof(DirectionalShape) : 0));
}

/// Records that are unpacked at once, column by column: they stay in the nearest cache, which a whole chunk
/// does not.
constexpr size_t block_records = 64;

/// Columns of `count` values in bytes planes, from the front: rows [first, last) are written or read.
template <typename Byte>
class Columns {
 public:
  Columns(Byte* bytes, size_t count, size_t first, size_t last)
      : at_(bytes), count_(count), first_(first), last_(last) {}

  /// Calls visit(i, bytes of value i's type) for every record.
  template <typename T, typename Value>
  void write(const Value& value) {
    for (size_t i = first_; i < last_; ++i) {
      const T number = value(i);
      std::array<uint8_t, sizeof(T)> bytes;
      std::memcpy(bytes.data(), &number, sizeof(T));
      for (size_t plane = 0; plane < sizeof(T); ++plane) at_[plane * count_ + i] = bytes[plane];
    }
    at_ += sizeof(T) * count_;
  }
  template <typename T, typename Take>
  void read(const Take& take) {
    for (size_t i = first_; i < last_; ++i) {
      std::array<uint8_t, sizeof(T)> bytes;
      for (size_t plane = 0; plane < sizeof(T); ++plane) bytes[plane] = at_[plane * count_ + i];
      T number;
      std::memcpy(&number, bytes.data(), sizeof(T));
      take(i, number);
    }
    at_ += sizeof(T) * count_;
  }

 private:
  Byte* at_;
  size_t count_;
  size_t first_;
  size_t last_;
};

/// The floats of a record, in the file's order.
template <typename Visitor>
void visit_floats(const Visitor& visit) {
  for (int axis = 0; axis < 3; ++axis) visit([axis](auto& record) -> auto& { return record.position[axis]; });
  for (int channel = 0; channel < 3; ++channel)
    visit([channel](auto& record) -> auto& { return record.radiance[channel]; });
  for (size_t channel = 0; channel < 3; ++channel)
    for (int axis = 0; axis < 3; ++axis)
      visit([ channel, axis ](auto& record) -> auto& { return record.gradient[channel][axis]; });
  for (size_t entry = 0; entry < 6; ++entry)
    visit([entry](auto& record) -> auto& { return record.hessian.entries[entry]; });
  visit([](auto& record) -> auto& { return record.variance; });
}

/// Those from `first`, not including `last`, out of the columns of a chunk.
void unpack_rows(const uint8_t* raw, const Component& component, std::span<Record> records, size_t first,
                 size_t last) {
  Columns<const uint8_t> columns(raw, records.size(), first, last);
  columns.read<uint64_t>([&](size_t i, uint64_t id) { records[i].id = id; });
  visit_floats([&](const auto& field) {
    columns.read<float>([&](size_t i, float value) { field(records[i]) = value; });
  });
  columns.read<uint32_t>([&](size_t i, uint32_t samples) { records[i].samples = samples; });
  for (size_t i = first; i < last; ++i) records[i].component = component;
  if (has_particular(component.quantity))
    columns.read<uint32_t>([&](size_t i, uint32_t packed) { unpack_particular(packed, records[i]); });
  columns.read<uint16_t>(
      [&](size_t i, uint16_t margin) { records[i].visibility_margin = unpack_margin(margin); });
  for (size_t bin = 0; bin < DepthBins::count; ++bin)
    columns.read<uint8_t>([&](size_t i, uint8_t code) { records[i].depth.codes[bin] = code; });
  if (has_shape(component.quantity)) {
    columns.read<int8_t>([&](size_t i, int8_t exponent) { records[i].shape.exponent = exponent; });
    for (size_t number = 0; number < DirectionalShape::count; ++number)
      columns.read<int8_t>([&](size_t i, int8_t value) { records[i].shape.numbers[number] = value; });
  }
}

}  // namespace

std::string pack_chunk(const RecordSet& set, size_t first, size_t count) {
  std::vector<Record> records(count);
  for (size_t i = 0; i < count; ++i) records[i] = set.record(first + i);
  const Quantity quantity = records[0].component.quantity;
  std::vector<uint8_t> raw(raw_bytes(quantity, count));
  Columns<uint8_t> columns(raw.data(), count, 0, count);
  columns.write<uint64_t>([&](size_t i) { return records[i].id; });
  visit_floats([&](const auto& field) { columns.write<float>([&](size_t i) { return field(records[i]); }); });
  columns.write<uint32_t>([&](size_t i) { return records[i].samples; });
  if (has_particular(quantity))
    columns.write<uint32_t>([&](size_t i) { return pack_particular(records[i]); });
  columns.write<uint16_t>([&](size_t i) { return pack_margin(records[i].visibility_margin); });
  for (size_t bin = 0; bin < DepthBins::count; ++bin)
    columns.write<uint8_t>([&](size_t i) { return records[i].depth.codes[bin]; });
  if (has_shape(quantity)) {
    columns.write<int8_t>([&](size_t i) { return records[i].shape.exponent; });
    for (size_t number = 0; number < DirectionalShape::count; ++number)
      columns.write<int8_t>([&](size_t i) { return records[i].shape.numbers[number]; });
  }

  std::string payload(ZSTD_compressBound(raw.size()), '\0');
  const size_t size =
      ZSTD_compress(payload.data(), payload.size(), raw.data(), raw.size(), compression_level);
  if (ZSTD_isError(size) != 0)
    throw Error(ErrorKind::internal, "COMPRESSION_FAILED",
                std::string("zstd can't compress records: ") + ZSTD_getErrorName(size));
  payload.resize(size);
  return payload;
}

bool unpack_chunk(std::string_view payload, const Component& component, std::span<Record> records) {
  std::vector<uint8_t> raw(raw_bytes(component.quantity, records.size()));
  const size_t size = ZSTD_decompress(raw.data(), raw.size(), payload.data(), payload.size());
  if (ZSTD_isError(size) != 0 || size != raw.size()) return false;
  for (size_t first = 0; first < records.size(); first += block_records)
    unpack_rows(raw.data(), component, records, first, std::min(first + block_records, records.size()));
  return true;
}

}  // namespace fogbank::cache
