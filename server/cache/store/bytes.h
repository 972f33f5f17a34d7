// Numbers as little-endian bytes.
#pragma once

#include <bit>
#include <cstring>
#include <optional>
#include <string>
#include <string_view>
#include <type_traits>

namespace fogbank::cache {

static_assert(std::endian::native == std::endian::little);

template <typename T>
void append_bytes(std::string& bytes, T value) {
  static_assert(std::is_trivially_copyable_v<T>);
  char buffer[sizeof(T)];
  std::memcpy(buffer, &value, sizeof(T));
  bytes.append(buffer, sizeof(T));
}

/// Reads from the front. Past the end it gives zeros and `ok` is false from then on.
class ByteReader {
 public:
  explicit ByteReader(std::string_view bytes) : bytes_(bytes) {}

  template <typename T>
  T take() {
    static_assert(std::is_trivially_copyable_v<T>);
    T value{};
    if (const std::string_view found = take(sizeof(T)); ok_) std::memcpy(&value, found.data(), sizeof(T));
    return value;
  }
  std::string_view take(size_t count) {
    if (!ok_ || count > bytes_.size() - position_) {
      ok_ = false;
      return {};
    }
    position_ += count;
    return bytes_.substr(position_ - count, count);
  }
  bool ok() const { return ok_; }
  size_t position() const { return position_; }
  size_t left() const { return bytes_.size() - position_; }

 private:
  std::string_view bytes_;
  size_t position_ = 0;
  bool ok_ = true;
};

}  // namespace fogbank::cache
