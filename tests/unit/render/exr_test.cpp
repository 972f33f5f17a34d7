#include "render/exr.h"

#include <OpenImageIO/filesystem.h>
#include <OpenImageIO/imageio.h>
#include <gtest/gtest.h>

#include <cmath>
#include <limits>

#include "core/error.h"
#include "function_integrator.h"

namespace fogbank::render {
namespace {

struct Decoded {
  OIIO::ImageSpec spec;
  std::vector<float> values;
};

Decoded decode(const std::string& bytes) {
  OIIO::Filesystem::IOMemReader memory(bytes.data(), bytes.size());
  const auto input = OIIO::ImageInput::open("memory.exr", nullptr, &memory);
  if (!input) throw std::runtime_error(OIIO::geterror());
  Decoded decoded{input->spec(), {}};
  decoded.values.resize(decoded.spec.image_pixels() * static_cast<size_t>(decoded.spec.nchannels));
  if (!input->read_image(0, 0, 0, -1, OIIO::TypeDesc::FLOAT, decoded.values.data())) {
    throw std::runtime_error(input->geterror());
  }
  return decoded;
}

TilePixels gradient_tile(const scene::Window& window) {
  TilePixels tile;
  tile.window = window;
  RandomStream random(7, 0, 0, 0);
  const auto count = static_cast<size_t>(window.width * window.height * 3);
  for (size_t i = 0; i < count; ++i) {
    tile.rgb.push_back(0.1f * static_cast<float>(i) + random.next_float());
  }
  return tile;
}

TEST(EncodeTile, FloatRoundTripIsExact) {
  for (const Compression compression : {Compression::none, Compression::zip}) {
    const TilePixels tile = gradient_tile({32, 48, 17, 9});
    const Decoded decoded = decode(encode_tile(tile, 100, 80, PixelType::single_float, compression));
    EXPECT_EQ(decoded.values, tile.rgb);
    EXPECT_EQ(decoded.spec.format, OIIO::TypeDesc::FLOAT);
    EXPECT_EQ(decoded.spec.get_string_attribute("compression"),
              compression == Compression::zip ? "zip" : "none");
  }
}

TEST(EncodeTile, Windows) {
  const Decoded decoded =
      decode(encode_tile(gradient_tile({32, 48, 17, 9}), 100, 80, PixelType::half_float, Compression::none));
  EXPECT_EQ(decoded.spec.x, 32);
  EXPECT_EQ(decoded.spec.y, 48);
  EXPECT_EQ(decoded.spec.width, 17);
  EXPECT_EQ(decoded.spec.height, 9);
  EXPECT_EQ(decoded.spec.full_x, 0);
  EXPECT_EQ(decoded.spec.full_y, 0);
  EXPECT_EQ(decoded.spec.full_width, 100);
  EXPECT_EQ(decoded.spec.full_height, 80);
  EXPECT_EQ(decoded.spec.channelnames, (std::vector<std::string>{"R", "G", "B"}));
  EXPECT_EQ(decoded.spec.format, OIIO::TypeDesc::HALF);
}

TEST(EncodeTile, HalfIsTheNearestAndClamped) {
  TilePixels tile;
  tile.window = {0, 0, 2, 1};
  tile.rgb = {1e30f, 65519.0f, 65536.0f, 1.0f / 3.0f, -1e9f, 1e-30f};
  const Decoded decoded = decode(encode_tile(tile, 2, 1, PixelType::half_float, Compression::none));
  EXPECT_EQ(decoded.values[0], 65504.0f);
  EXPECT_EQ(decoded.values[1], 65504.0f);
  EXPECT_EQ(decoded.values[2], 65504.0f);
  EXPECT_NEAR(decoded.values[3], 1.0f / 3.0f, 0x1p-13f);  // half an ulp of a half in [1/4, 1/2)
  EXPECT_EQ(decoded.values[4], -65504.0f);
  EXPECT_EQ(decoded.values[5], 0.0f);
}

TEST(EncodeTile, EveryTileFitsIntoAMessage) {
  for (const int32_t size : {RenderLimits::smallest_tile, 32, 64, 100, RenderLimits::largest_tile}) {
    const scene::Window window{0, 0, size, size};
    TilePixels tile = gradient_tile(window);
    // Noise that doesn't compress.
    RandomStream random(1, 2, 3, 4);
    for (float& value : tile.rgb) value = std::exp2(40 * random.next_float() - 20);
    for (const PixelType type : {PixelType::half_float, PixelType::single_float}) {
      const auto raw = static_cast<size_t>(size * size * 3 * (type == PixelType::half_float ? 2 : 4));
      const std::string chosen = encode_tile(tile, 16384, 16384, type, tile_compression(window, type));
      EXPECT_LT(chosen.size(), 256u << 10);
      // The header, and 16 bytes a row for its place, number and length.
      EXPECT_LE(chosen.size(), raw + 1024 + 16 * static_cast<size_t>(size));
    }
  }
}

TEST(EncodeTile, NothingThatIsNotFiniteLeaves) {
  for (const float bad : {std::numeric_limits<float>::quiet_NaN(), std::numeric_limits<float>::infinity()}) {
    TilePixels tile = gradient_tile({0, 0, 8, 8});
    tile.rgb[5] = bad;
    EXPECT_THROW(encode_tile(tile, 8, 8, PixelType::half_float, Compression::none), Error);
  }
}

TEST(EncodeImage, RoundTripWithVarianceAndProvenance) {
  RenderSettings settings = small_settings(90, 70, 6);
  settings.film.crop = {10, 20, 61, 43};
  settings.seed = 18446744073709551615u;
  RenderJob job(function_integrator(ray_and_random_function), settings);
  run_to_completion(job, 2);
  const Image image = job.image();
  const std::string fingerprint(64, 'a');
  const Decoded decoded =
      decode(encode_image(image, PixelType::single_float, true,
                          describe(job.settings(), job.progress(), job.history(), fingerprint)));
  EXPECT_EQ(decoded.spec.x, 10);
  EXPECT_EQ(decoded.spec.y, 20);
  EXPECT_EQ(decoded.spec.width, 61);
  EXPECT_EQ(decoded.spec.height, 43);
  EXPECT_EQ(decoded.spec.full_width, 90);
  EXPECT_EQ(decoded.spec.full_height, 70);
  ASSERT_EQ(decoded.spec.channelnames,
            (std::vector<std::string>{"R", "G", "B", "variance.R", "variance.G", "variance.B"}));
  for (size_t pixel = 0; pixel < 61 * 43; ++pixel) {
    for (size_t channel = 0; channel < 3; ++channel) {
      ASSERT_EQ(decoded.values[6 * pixel + channel], image.rgb[3 * pixel + channel]);
      ASSERT_EQ(decoded.values[6 * pixel + 3 + channel], image.variance[3 * pixel + channel]);
    }
  }
  EXPECT_EQ(decoded.spec.get_string_attribute("fogbank:scene"), fingerprint);
  EXPECT_EQ(decoded.spec.get_string_attribute("fogbank:integrator"), "volpath");
  EXPECT_EQ(decoded.spec.get_string_attribute("fogbank:seed"), "18446744073709551615");
  EXPECT_EQ(decoded.spec.get_string_attribute("fogbank:samples_per_pixel"), "6");
  EXPECT_EQ(decoded.spec.get_string_attribute("fogbank:samples"), std::to_string(61 * 43 * 6));
  EXPECT_EQ(decoded.spec.get_string_attribute("fogbank:version"), FOGBANK_VERSION);
  EXPECT_NE(decoded.spec.get_string_attribute("fogbank:settings").find("\"crop\":[10,20,61,43]"),
            std::string::npos);
  EXPECT_FALSE(decoded.spec.get_string_attribute("fogbank:render_seconds").empty());
}

TEST(EncodeImage, WithoutVariance) {
  const Image image = render_function(small_settings(33, 20, 2), 1);
  const Decoded decoded = decode(encode_image(image, PixelType::single_float, false, {}));
  EXPECT_EQ(decoded.spec.nchannels, 3);
  EXPECT_EQ(decoded.values, image.rgb);
}

}  // namespace
}  // namespace fogbank::render
