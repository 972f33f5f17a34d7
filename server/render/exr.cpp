#include "render/exr.h"

#include <OpenImageIO/filesystem.h>
#include <OpenImageIO/imageio.h>

#include <algorithm>
#include <cmath>
#include <mutex>

#include "core/error.h"

namespace fogbank::render {

namespace {

constexpr float largest_half = 65504.0f;
constexpr int64_t largest_uncompressed_bytes = 128 << 10;

[[noreturn]] void fail(const std::string& message) {
  throw Error(ErrorKind::internal, "EXR_ENCODING", "cannot encode EXR: " + message);
}

// Without its own thread pool OpenEXR encodes a small tile four times faster, and the render's threads are
// busy anyway.
void configure_once() {
  static std::once_flag once;
  std::call_once(once, [] { OIIO::attribute("exr_threads", -1); });
}

// Beyond its range a half becomes infinite.
void make_storable(std::vector<float>& values, PixelType type) {
  const float limit = type == PixelType::half_float ? largest_half : std::numeric_limits<float>::max();
  for (float& value : values) {
    if (!std::isfinite(value)) throw Error(ErrorKind::internal, "NON_FINITE_PIXEL", "a pixel is not finite");
    value = std::clamp(value, -limit, limit);
  }
}

OIIO::ImageSpec make_spec(const scene::Window& window, int32_t full_width, int32_t full_height,
                          std::vector<std::string> channels, PixelType type, Compression compression) {
  OIIO::ImageSpec spec(window.width, window.height, static_cast<int>(channels.size()),
                       type == PixelType::half_float ? OIIO::TypeDesc::HALF : OIIO::TypeDesc::FLOAT);
  spec.channelnames = std::move(channels);
  spec.x = window.x;
  spec.y = window.y;
  spec.full_x = 0;
  spec.full_y = 0;
  spec.full_width = full_width;
  spec.full_height = full_height;
  spec.attribute("compression", compression == Compression::zip ? "zip" : "none");
  spec.attribute("Software", "Fogbank " FOGBANK_VERSION);
  // ITU-R BT.709 primaries and D65, which linear sRGB is made of.
  constexpr float chromaticities[8] = {0.64f, 0.33f, 0.30f, 0.60f, 0.15f, 0.06f, 0.3127f, 0.3290f};
  spec.attribute("chromaticities", OIIO::TypeDesc(OIIO::TypeDesc::FLOAT, 8), chromaticities);
  return spec;
}

std::string write(const OIIO::ImageSpec& spec, const std::vector<float>& values) {
  configure_once();
  const auto output = OIIO::ImageOutput::create("openexr");
  if (!output) fail(OIIO::geterror());
  OIIO::Filesystem::IOVecOutput memory;
  if (!output->set_ioproxy(&memory)) fail("OpenImageIO can't write EXR to memory");
  if (!output->open("memory.exr", spec) || !output->write_image(OIIO::TypeDesc::FLOAT, values.data()) ||
      !output->close()) {
    fail(output->geterror());
  }
  const auto& bytes = memory.buffer();
  return std::string(bytes.begin(), bytes.end());
}

}  // namespace

Compression tile_compression(const scene::Window& window, PixelType type) {
  const int64_t bytes = int64_t{window.width} * window.height * 3 * (type == PixelType::half_float ? 2 : 4);
  return bytes <= largest_uncompressed_bytes ? Compression::none : Compression::zip;
}

std::string encode_tile(const TilePixels& tile, int32_t full_width, int32_t full_height, PixelType type,
                        Compression compression) {
  std::vector<float> values = tile.rgb;
  make_storable(values, type);
  return write(make_spec(tile.window, full_width, full_height, {"R", "G", "B"}, type, compression), values);
}

std::string encode_image(const Image& image, PixelType type, bool variance, const Provenance& provenance) {
  std::vector<std::string> channels{"R", "G", "B"};
  if (variance) channels.insert(channels.end(), {"variance.R", "variance.G", "variance.B"});
  for (const ImageChannel& aov : image.aovs) channels.push_back(aov.name);
  std::vector<float> values;
  values.reserve(image.rgb.size() / 3 * channels.size());
  for (size_t first = 0; first < image.rgb.size(); first += 3) {
    values.insert(values.end(), &image.rgb[first], &image.rgb[first] + 3);
    if (variance) values.insert(values.end(), &image.variance[first], &image.variance[first] + 3);
    for (const ImageChannel& aov : image.aovs) values.push_back(aov.values[first / 3]);
  }
  make_storable(values, type);
  OIIO::ImageSpec spec = make_spec(image.window, image.full_width, image.full_height, std::move(channels),
                                   type, Compression::zip);
  for (const auto& [name, text] : provenance) spec.attribute(name, text);
  return write(spec, values);
}

}  // namespace fogbank::render
