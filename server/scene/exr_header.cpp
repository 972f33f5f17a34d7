#include "scene/exr_header.h"

#include <bit>
#include <cstring>
#include <optional>

namespace fogbank::scene {

namespace {

static_assert(std::endian::native == std::endian::little, "the format is little endian");

class AttributeReader {
 public:
  explicit AttributeReader(const std::string& bytes) : bytes_(bytes) {}

  /// Text up to a NUL; nothing when it does not end within 256 bytes.
  std::optional<std::string> text() {
    constexpr size_t longest = 256;
    const size_t end = bytes_.find('\0', offset_);
    if (end == std::string::npos || end - offset_ > longest) return std::nullopt;
    std::string value = bytes_.substr(offset_, end - offset_);
    offset_ = end + 1;
    return value;
  }

  template <class T>
  std::optional<T> value() {
    if (offset_ > bytes_.size() || bytes_.size() - offset_ < sizeof(T)) return std::nullopt;
    T v;
    std::memcpy(&v, bytes_.data() + offset_, sizeof(T));
    offset_ += sizeof(T);
    return v;
  }

  size_t offset() const { return offset_; }
  bool move_to(size_t offset) {
    offset_ = offset;
    return offset <= bytes_.size();
  }

 private:
  const std::string& bytes_;
  size_t offset_ = 8;  ///< behind magic number and version
};

}  // namespace

ExrSize read_exr_size(const std::string& bytes) {
  ExrSize size;
  bool has_window = false;
  AttributeReader reader(bytes);
  while (true) {
    const auto name = reader.text();
    if (!name) return size;
    if (name->empty()) break;
    const auto type = reader.text();
    const auto length = reader.value<uint32_t>();
    if (!type || !length) return size;
    const size_t next = reader.offset() + *length;
    if (*name == "dataWindow") {
      const auto x_min = reader.value<int32_t>();
      const auto y_min = reader.value<int32_t>();
      const auto x_max = reader.value<int32_t>();
      const auto y_max = reader.value<int32_t>();
      if (!y_max) return size;
      size.x = *x_min;
      size.y = *y_min;
      size.width = int64_t{*x_max} - *x_min + 1;
      size.height = int64_t{*y_max} - *y_min + 1;
      has_window = true;
    } else if (*name == "tiles") {
      const auto width = reader.value<uint32_t>();
      const auto height = reader.value<uint32_t>();
      if (!height || *width == 0 || *height == 0) return size;
      size.tile_width = *width;
      size.tile_height = *height;
    }
    if (!reader.move_to(next)) return size;
  }
  size.is_valid = has_window;
  return size;
}

}  // namespace fogbank::scene
