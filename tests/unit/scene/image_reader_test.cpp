// Images: what is read and what is refused.
#include "scene/image_reader.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <cstring>
#include <limits>

#include "scene/image_files.h"
#include "scene/shared_data.h"

namespace fogbank::scene::test {
namespace {

using ::testing::HasSubstr;

const SourceLocation where{"scene.xml", 3, "<texture>"};

Image read(const std::string& bytes, bool raw = false, const std::string& path = "a.img") {
  return read_image(bytes, path, raw, where);
}

void expect_refused(const std::string& bytes, const std::string& reason, const std::string& message,
                    const std::string& path = "a.img") {
  try {
    read(bytes, false, path);
    ADD_FAILURE() << "accepted; expected: " << message;
  } catch (const SceneError& error) {
    EXPECT_EQ(error.reason(), reason) << error.what();
    EXPECT_THAT(error.what(), HasSubstr("scene.xml:3: <texture>: " + path + ": " + message));
  }
}

float decoded(double value) {
  return static_cast<float>(value <= 0.04045 ? value / 12.92 : std::pow((value + 0.055) / 1.055, 2.4));
}

TEST(ImageReaderTest, EightBitImagesStayEightBits) {
  const std::string bytes = image_file("png", 4, 3, grid);
  const Image image = read(bytes);
  EXPECT_EQ(image.width, 4);
  EXPECT_EQ(image.height, 3);
  EXPECT_EQ(image.channels, 1);
  EXPECT_TRUE(image.data.empty());
  EXPECT_EQ(image.bytes, grid);
  EXPECT_EQ(image.texel(1, 0).x, decoded(60 / 255.0));
  EXPECT_EQ(image.texel(3, 2), Spectrum(1));
  EXPECT_EQ(image.lowest, 0.0f);
  EXPECT_EQ(image.highest, 1.0f);
  EXPECT_EQ(read(bytes, true).texel(1, 0).x, static_cast<float>(60 / 255.0));
}

TEST(ImageReaderTest, EveryFormatOfTheList) {
  const std::vector<uint8_t> rgb = {255, 0, 0, 0, 255, 0, 0, 0, 255, 64, 64, 64};
  for (const std::string format : {"png", "tiff", "bmp", "targa"}) {
    const Image image = read(image_file(format, 2, 2, rgb), true, "a.TGA");
    EXPECT_EQ(image.texel(1, 0), Spectrum(0, 1, 0)) << format;
    EXPECT_EQ(image.texel(0, 1), Spectrum(0, 0, 1)) << format;
  }
  // Lossy: flat colours come back within a few steps of 255.
  const Image jpeg = read(image_file("jpeg", 8, 8, std::vector<uint8_t>(8 * 8 * 3, 100)), true);
  EXPECT_NEAR(jpeg.texel(4, 4).y, 100 / 255.0f, 3 / 255.0f);
  const std::vector<float> numbers = {1.5f, 0.25f, 8.0f, 0.5f, 0.5f, 0.5f};
  EXPECT_EQ(read(image_file("openexr", 2, 1, numbers)).texel(0, 0), Spectrum(1.5f, 0.25f, 8.0f));
  // Shared exponent: 8 bits for the largest channel.
  const Image hdr = read(image_file("hdr", 2, 1, numbers));
  EXPECT_NEAR(hdr.texel(0, 0).z, 8.0f, 8.0f / 128);
  EXPECT_NEAR(hdr.texel(1, 0).x, 0.5f, 0.5f / 128);
}

TEST(ImageReaderTest, SixteenBitsAreDecodedToo) {
  const std::string bytes = image_file<uint16_t>("png", 2, 1, {0, 0, 0, 30000, 65535, 1});
  EXPECT_NEAR(read(bytes).texel(1, 0).x, decoded(30000 / 65535.0), 1e-7f);
  EXPECT_NEAR(read(bytes, true).texel(1, 0).x, static_cast<float>(30000 / 65535.0), 1e-7f);
  EXPECT_EQ(read(bytes).texel(1, 0).y, 1.0f);
}

TEST(ImageReaderTest, AlphaIsDroppedAndNotMultipliedIn) {
  const Image color = read(image_file<uint8_t>("png", 1, 1, {100, 150, 200, 50}), true);
  EXPECT_EQ(color.channels, 3);
  EXPECT_EQ(color.texel(0, 0), Spectrum(100 / 255.0f, 150 / 255.0f, 200 / 255.0f));
  const Image grey = read(image_file<uint8_t>("png", 1, 1, {100, 50}), true);
  EXPECT_EQ(grey.channels, 1);
  EXPECT_EQ(grey.texel(0, 0), Spectrum(100 / 255.0f));
}

TEST(ImageReaderTest, ChannelsOfAnExrByName) {
  const std::vector<float> values = {1, 2, 3, 4, 5};
  EXPECT_EQ(read(image_file("openexr", 1, 1, values, {"B", "R", "Z", "G", "A"})).texel(0, 0),
            Spectrum(2, 4, 1));
  EXPECT_EQ(read(image_file<float>("openexr", 1, 1, {7, 8}, {"Y", "A"})).texel(0, 0), Spectrum(7));
}

TEST(ImageReaderTest, DamagedImagesAreRefused) {
  expect_refused("", "UNSUPPORTED_IMAGE", "not an image of a supported format; supported: OpenEXR, PNG");
  expect_refused("GIF89a...", "UNSUPPORTED_IMAGE", "not an image of a supported format");
  expect_refused("<svg/>", "UNSUPPORTED_IMAGE", "not an image of a supported format", "a.png");
  // Any image cut off in the middle claims a size that it does not have.
  std::vector<uint8_t> noise(64 * 64 * 3);
  for (size_t i = 0; i < noise.size(); ++i) noise[i] = static_cast<uint8_t>(i * i * 2654435761u >> 13);
  std::vector<float> floats(noise.begin(), noise.end());
  for (const std::string format : {"png", "jpeg", "bmp", "targa", "tiff"}) {
    const std::string whole = image_file(format, 64, 64, noise);
    EXPECT_NO_THROW(read(whole, false, "a.tga")) << format;
    expect_refused(whole.substr(0, whole.size() / 2), "DAMAGED_IMAGE", "", "a.tga");
  }
  for (const std::string format : {"openexr", "hdr"}) {
    const std::string whole = image_file(format, 64, 64, floats);
    EXPECT_NO_THROW(read(whole)) << format;
    expect_refused(whole.substr(0, whole.size() / 2), "DAMAGED_IMAGE", "");
  }
}

TEST(ImageReaderTest, TexelsThatAreNotFiniteAreNamed) {
  std::vector<float> values(3 * 2 * 3, 0.5f);
  values[(1 * 3 + 2) * 3 + 1] = std::numeric_limits<float>::quiet_NaN();
  expect_refused(image_file("openexr", 3, 2, values), "DAMAGED_IMAGE", "texel (2, 1) is not a finite number");
  values[0] = infinity;
  expect_refused(image_file("openexr", 3, 2, values), "DAMAGED_IMAGE", "texel (0, 0) is not a finite number");
}

/// Overwrites the data window of an OpenEXR file, and its display window with it.
std::string with_exr_size(std::string bytes, int32_t width, int32_t height) {
  for (const std::string& name : {std::string("dataWindow"), std::string("displayWindow")}) {
    const size_t value = bytes.find(name + '\0' + "box2i") + name.size() + 1 + 6 + 4;
    const int32_t window[4] = {0, 0, width - 1, height - 1};
    std::memcpy(bytes.data() + value, window, sizeof(window));
  }
  return bytes;
}

TEST(ImageReaderTest, ClaimedSizesAreCheckedOnTheHeader) {
  const std::string small = image_file("openexr", 16, 16, std::vector<float>(16 * 16 * 3, 1.0f));
  EXPECT_NO_THROW(read(with_exr_size(small, 16, 16)));
  expect_refused(with_exr_size(small, 60000, 60000), "IMAGE_TOO_LARGE",
                 "60000 x 60000 texels; the limit is 32768");
  expect_refused(with_exr_size(small, 32768, 32768), "IMAGE_TOO_LARGE", "32768 x 32768 texels take");
  expect_refused(with_exr_size(small, 2147483647, 2147483647), "IMAGE_TOO_LARGE", "");
  expect_refused(with_exr_size(small, 0, 16), "DAMAGED_IMAGE", "the header states a size of 0 x 16");
  expect_refused(with_exr_size(small, -5, 16), "DAMAGED_IMAGE", "the header states a size of -5 x 16");
  expect_refused(with_exr_size(small, 4096, 4096), "DAMAGED_IMAGE", "");

  std::string png = image_file("png", 4, 3, grid);
  for (const size_t offset : {size_t{16}, size_t{20}}) {  // IHDR: width and height, big endian
    png[offset] = 0;
    png[offset + 1] = static_cast<char>(0xEA);
    png[offset + 2] = static_cast<char>(0x60);
  }
  // The chunk's checksum is wrong now; libpng says so before the size is looked at.
  expect_refused(png, "DAMAGED_IMAGE", "");

  std::string hdr = image_file("hdr", 4, 1, std::vector<float>(12, 1.0f));
  const size_t size = hdr.find("-Y 1 +X 4");
  ASSERT_NE(size, std::string::npos);
  hdr.replace(size, 9, "-Y 60000 +X 60000");
  expect_refused(hdr, "IMAGE_TOO_LARGE", "60000 x 60000 texels; the limit is 32768");

  std::string bmp = image_file("bmp", 4, 3, std::vector<uint8_t>(36, 9));
  const int32_t sides[2] = {60000, 60000};
  std::memcpy(bmp.data() + 18, sides, sizeof(sides));
  expect_refused(bmp, "IMAGE_TOO_LARGE", "60000 x 60000 texels");
}

TEST(ImageReaderTest, NoTruncationOrFlippedByteDoesHarm) {
  const std::string exr = image_file("openexr", 8, 8, std::vector<float>(8 * 8 * 3, 0.25f));
  const std::string png = image_file("png", 4, 3, grid);
  for (const std::string& whole : {exr, png}) {
    for (size_t i = 0; i < whole.size(); ++i) {
      std::string damaged = whole;
      damaged[i] = static_cast<char>(damaged[i] ^ 0x41);
      for (const std::string& bytes : {damaged, whole.substr(0, i)}) {
        try {
          const Image image = read(bytes);
          EXPECT_TRUE(std::isfinite(image.highest));
        } catch (const SceneError&) {
        }
      }
    }
  }
}

// Texels of `mi.Bitmap` (Mitsuba 3.9.1) for the same files; bytes of JPEGs as they are.
struct SharedTexel {
  const char* path;  ///< below data/
  int width, height, x, y;
  double values[3];
};
constexpr SharedTexel shared_texels[] = {
    {"envmaps/museum.exr", 512, 256, 0, 0, {0.2666015625, 0.15380859375, 0.0751953125}},
    {"envmaps/museum.exr", 512, 256, 170, 64, {0.19921875, 0.093505859375, 0.041290283203125}},
    {"envmaps/museum.exr",
     512,
     256,
     511,
     255,
     {0.0003159046173095703, 0.00020313262939453125, 0.0001366138458251953}},
    {"envmaps/parking_lot-small.exr", 500, 250, 0, 0, {0.30126953125, 0.46875, 0.56591796875}},
    {"envmaps/parking_lot-small.exr", 500, 250, 166, 62, {0.4345703125, 0.64990234375, 0.75390625}},
    {"envmaps/parking_lot-small.exr",
     500,
     250,
     499,
     249,
     {0.07342529296875, 0.07354736328125, 0.06890869140625}},
    {"envmaps/vogl_envmap.hdr", 1024, 512, 0, 0, {0.2177734375, 0.1748046875, 0.07421875}},
    {"envmaps/vogl_envmap.hdr", 1024, 512, 341, 128, {0.8125, 0.953125, 3.390625}},
    {"envmaps/vogl_envmap.hdr", 1024, 512, 1023, 511, {0.0, 0.0, 0.0}},
    {"classroom/textures/blackboard.jpg", 1600, 1600, 0, 0, {197.0, 143.0, 99.0}},
    {"classroom/textures/blackboard.jpg", 1600, 1600, 533, 400, {235.0, 192.0, 150.0}},
    {"classroom/textures/blackboard.jpg", 1600, 1600, 1599, 1599, {205.0, 161.0, 116.0}},
    {"classroom/textures/wood1.jpg", 259, 194, 0, 0, {191.0, 125.0, 28.0}},
    {"classroom/textures/wood1.jpg", 259, 194, 86, 48, {175.0, 101.0, 26.0}},
    {"classroom/textures/wood1.jpg", 259, 194, 258, 193, {197.0, 129.0, 32.0}},
    {"staircase2/textures/Wallpaper.jpg", 512, 512, 0, 0, {255.0, 253.0, 207.0}},
    {"staircase2/textures/Wallpaper.jpg", 512, 512, 170, 128, {134.0, 112.0, 52.0}},
    {"staircase2/textures/Wallpaper.jpg", 512, 512, 511, 511, {255.0, 253.0, 211.0}},
};

TEST(ImageReaderTest, SharedImagesAgreeWithMitsuba) {
  size_t missing = 0;
  for (const SharedTexel& expected : shared_texels) {
    std::string bytes;
    if (!fogbank::test::read_shared(std::string("data/") + expected.path, bytes)) {
      ++missing;
      continue;
    }
    const Image image = read(bytes, true);
    EXPECT_EQ(image.width, expected.width) << expected.path;
    EXPECT_EQ(image.height, expected.height) << expected.path;
    const Spectrum texel = image.texel(expected.x, expected.y);
    // JPEG decoders may differ by one step in the inverse cosine transform; the other formats are exact.
    const bool is_jpeg = !image.bytes.empty();
    for (int channel = 0; channel < 3; ++channel) {
      EXPECT_NEAR(texel[channel] * (is_jpeg ? 255.0 : 1.0), expected.values[channel], is_jpeg ? 1.001 : 0.0)
          << expected.path << " " << expected.x << " " << expected.y;
    }
  }
  if (missing > 0)
    GTEST_SKIP() << missing << " of " << std::size(shared_texels) << " texels: shared files are not here";
}

}  // namespace
}  // namespace fogbank::scene::test
