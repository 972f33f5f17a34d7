#include "scene/image_reader.h"

#include <OpenImageIO/filesystem.h>
#include <OpenImageIO/imageio.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <memory>
#include <string_view>

#include "scene/exr_header.h"
#include "scene/loader.h"

namespace fogbank::scene {

namespace {

/// Name of OpenImageIO's reader for the content; empty when it is none that is supported. Readers are asked
/// for by name because OpenImageIO otherwise tries all it has, on the disk too.
std::string format_of(const std::string& bytes, const std::string& path) {
  const std::string_view start(bytes.data(), std::min<size_t>(bytes.size(), 16));
  const auto begins = [start](std::string_view mark) { return start.substr(0, mark.size()) == mark; };
  if (begins("\x76\x2f\x31\x01")) return "openexr";
  if (begins("\x89PNG\r\n\x1a\n")) return "png";
  if (begins("\xff\xd8\xff")) return "jpeg";
  if (begins("#?")) return "hdr";
  if (begins(std::string_view("II*\0", 4)) || begins(std::string_view("MM\0*", 4))) return "tiff";
  if (begins("BM")) return "bmp";
  std::string ending = path.substr(std::min(path.size(), path.find_last_of('.')));
  std::transform(ending.begin(), ending.end(), ending.begin(),
                 [](char c) { return c >= 'A' && c <= 'Z' ? static_cast<char>(c + 32) : c; });
  return ending == ".tga" ? "targa" : "";
}

/// IEC 61966-2-1, the decoding of sRGB.
double srgb_to_linear(double value) {
  return value <= 0.04045 ? value / 12.92 : std::pow((value + 0.055) / 1.055, 2.4);
}

/// Are all of a PNG's chunks (length, type, data, checksum) there, up to IEND? OpenImageIO 2.4.7 leaks memory
/// with every PNG that libpng finds too short.
bool has_all_png_chunks(const std::string& bytes) {
  constexpr size_t signature_bytes = 8;
  constexpr size_t frame_bytes = 12;
  size_t offset = signature_bytes;
  while (bytes.size() - offset >= frame_bytes) {
    uint64_t length = 0;
    for (size_t i = 0; i < 4; ++i) length = length << 8 | static_cast<uint8_t>(bytes[offset + i]);
    if (length > bytes.size() - offset - frame_bytes) return false;
    if (bytes.compare(offset + 4, 4, "IEND") == 0) return true;
    offset += frame_bytes + length;
  }
  return false;
}

/// Where the wanted channels are.
struct ChannelChoice {
  int first = 0;
  int count = 1;
};

class ImageReader {
 public:
  ImageReader(const std::string& bytes, const std::string& path, const SourceLocation& where)
      : bytes_(bytes), path_(path), where_(where), memory_(bytes.data(), bytes.size()) {}

  Image read(bool raw) {
    const OIIO::ImageSpec spec = open();
    const ChannelChoice channels = choose_channels(spec);
    const bool is_integer = spec.format.basetype != OIIO::TypeDesc::HALF &&
                            spec.format.basetype != OIIO::TypeDesc::FLOAT &&
                            spec.format.basetype != OIIO::TypeDesc::DOUBLE;
    const bool is_bytes = spec.format.basetype == OIIO::TypeDesc::UINT8 && spec.channelformats.empty();
    check_size(spec.width, spec.height, static_cast<size_t>(channels.count) * (is_bytes ? 1 : sizeof(float)));
    Image image;
    image.width = spec.width;
    image.height = spec.height;
    image.channels = channels.count;
    const size_t values = static_cast<size_t>(spec.width) * static_cast<size_t>(spec.height) *
                          static_cast<size_t>(channels.count);
    if (is_bytes) {
      image.decode = byte_decoding(raw);
      image.bytes.resize(values);
      read_pixels(channels, OIIO::TypeDesc::UINT8, image.bytes.data());
      const auto [lowest, highest] = std::minmax_element(image.bytes.begin(), image.bytes.end());
      image.lowest = (*image.decode)[*lowest];
      image.highest = (*image.decode)[*highest];
      return image;
    }
    image.data.resize(values);
    read_pixels(channels, OIIO::TypeDesc::FLOAT, image.data.data());
    if (is_integer && !raw) {
      for (float& value : image.data) value = static_cast<float>(srgb_to_linear(static_cast<double>(value)));
    }
    check_values(image);
    return image;
  }

 private:
  [[noreturn]] void fail(ErrorKind kind, const std::string& reason, const std::string& message) const {
    throw SceneError(kind, reason, where_, path_ + ": " + message);
  }
  [[noreturn]] void damaged(const std::string& message) const {
    fail(ErrorKind::invalid_argument, "DAMAGED_IMAGE", message);
  }

  /// OpenImageIO's errors since the last call, on one line.
  std::string library_message() const {
    std::string message = input_->geterror();
    std::replace(message.begin(), message.end(), '\n', ' ');
    return message.empty() ? "can't be read" : message;
  }

  OIIO::ImageSpec open() {
    const std::string format = format_of(bytes_, path_);
    if (format.empty())
      fail(ErrorKind::unsupported, "UNSUPPORTED_IMAGE",
           "not an image of a supported format; supported: OpenEXR, PNG, JPEG, Radiance HDR, TIFF, BMP, "
           "Targa");
    // OpenEXR allocates by its header's word while opening.
    if (format == "openexr") check_exr_header();
    // libjpeg fills up what is missing and calls it a warning; a whole file has an end marker.
    if (format == "jpeg" && bytes_.rfind("\xff\xd9") == std::string::npos) damaged("the file is cut off");
    if (format == "png" && !has_all_png_chunks(bytes_)) damaged("the file is cut off");
    input_ = OIIO::ImageInput::create(format, false, nullptr, &memory_);
    if (input_ == nullptr || !input_->supports("ioproxy"))
      fail(ErrorKind::internal, "IMAGE_READER_MISSING",
           "OpenImageIO has no reader \"" + format + "\" for memory");
    OIIO::ImageSpec configuration;
    configuration.attribute("oiio:UnassociatedAlpha", 1);
    OIIO::ImageSpec spec;
    input_->set_ioproxy(&memory_);
    if (!input_->open("image", spec, configuration)) damaged(library_message());
    if (spec.depth != 1 || spec.deep)
      fail(ErrorKind::unsupported, "UNSUPPORTED_IMAGE", "volumes and deep images are not supported");
    return spec;
  }

  void check_exr_header() const {
    const ExrSize size = read_exr_size(bytes_);
    if (!size.is_valid) damaged("the OpenEXR header is damaged");
    check_size(size.width, size.height, sizeof(float));
    if (size.tile_width < 0) return;
    // A table entry per tile is allocated before the first is read.
    constexpr int64_t most_tiles = int64_t{1} << 22;
    const int64_t tiles =
        ((size.width - 1) / size.tile_width + 1) * ((size.height - 1) / size.tile_height + 1);
    if (tiles > most_tiles)
      fail(ErrorKind::resource_exhausted, "IMAGE_TOO_LARGE",
           std::to_string(tiles) + " tiles; the limit is " + std::to_string(most_tiles));
  }

  void check_size(int64_t width, int64_t height, size_t bytes_per_texel) const {
    if (width < 1 || height < 1)
      damaged("the header states a size of " + std::to_string(width) + " x " + std::to_string(height));
    if (width > LoadLimits::image_side || height > LoadLimits::image_side)
      fail(ErrorKind::resource_exhausted, "IMAGE_TOO_LARGE",
           std::to_string(width) + " x " + std::to_string(height) + " texels; the limit is " +
               std::to_string(LoadLimits::image_side) + " on a side");
    const size_t size = static_cast<size_t>(width) * static_cast<size_t>(height) * bytes_per_texel;
    if (size > LoadLimits::image_bytes)
      fail(ErrorKind::resource_exhausted, "IMAGE_TOO_LARGE",
           std::to_string(width) + " x " + std::to_string(height) + " texels take " + std::to_string(size) +
               " bytes; the limit is " + std::to_string(LoadLimits::image_bytes));
  }

  ChannelChoice choose_channels(const OIIO::ImageSpec& spec) const {
    const auto& names = spec.channelnames;
    const auto index = [&names](const char* name) {
      const auto found = std::find(names.begin(), names.end(), name);
      return found == names.end() ? -1 : static_cast<int>(found - names.begin());
    };
    if (index("RY") >= 0 || index("BY") >= 0)
      fail(ErrorKind::unsupported, "UNSUPPORTED_IMAGE",
           "luminance-chroma channels are not supported; R, G, B and Y are");
    const int red = index("R");
    if (red >= 0 && index("G") == red + 1 && index("B") == red + 2) return {red, 3};
    if (index("Y") >= 0) return {index("Y"), 1};
    return {0, spec.nchannels >= 3 ? 3 : 1};
  }

  void read_pixels(const ChannelChoice& channels, OIIO::TypeDesc type, void* pixels) {
    const bool is_read =
        input_->read_image(0, 0, channels.first, channels.first + channels.count, type, pixels);
    // The TIFF reader reports success with strips missing, and only notes the error.
    if (!is_read || input_->has_error()) damaged(library_message());
  }

  void check_values(Image& image) const {
    image.lowest = image.data.front();
    image.highest = image.data.front();
    for (size_t i = 0; i < image.data.size(); ++i) {
      const float value = image.data[i];
      if (!std::isfinite(value)) {
        const size_t texel = i / static_cast<size_t>(image.channels);
        const auto width = static_cast<size_t>(image.width);
        damaged("texel (" + std::to_string(texel % width) + ", " + std::to_string(texel / width) +
                ") is not a finite number");
      }
      image.lowest = std::min(image.lowest, value);
      image.highest = std::max(image.highest, value);
    }
  }

  const std::string& bytes_;
  const std::string& path_;
  const SourceLocation& where_;
  OIIO::Filesystem::IOMemReader memory_;
  std::unique_ptr<OIIO::ImageInput> input_;
};

}  // namespace

const std::array<float, 256>* byte_decoding(bool raw) {
  const auto make = [](bool is_linear) {
    std::array<float, 256> table{};
    for (size_t i = 0; i < table.size(); ++i) {
      const double value = static_cast<double>(i) / 255.0;
      table[i] = static_cast<float>(is_linear ? value : srgb_to_linear(value));
    }
    return table;
  };
  static const std::array<float, 256> linear = make(true);
  static const std::array<float, 256> srgb = make(false);
  return raw ? &linear : &srgb;
}

Image read_image(const std::string& bytes, const std::string& path, bool raw, const SourceLocation& where) {
  // OpenEXR's own thread pool costs more than it brings for images of this size, and its threads would be
  // outside the server's limit.
  static const bool single_threaded = OIIO::attribute("exr_threads", -1) && OIIO::attribute("threads", 1);
  static_cast<void>(single_threaded);
  return ImageReader(bytes, path, where).read(raw);
}

}  // namespace fogbank::scene
