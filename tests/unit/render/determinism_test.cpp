// The same inputs give the same pixels, bit for bit, however the work is split.
#include <gtest/gtest.h>

#include <cstring>

#include "function_integrator.h"
#include "render/film.h"
#include "render/film_camera.h"

namespace fogbank::render {
namespace {

// Neither side a multiple of a tile's.
const RenderSettings reference_settings = small_settings(83, 57, 11);

bool same_bits(const std::vector<float>& a, const std::vector<float>& b) {
  return a.size() == b.size() && std::memcmp(a.data(), b.data(), a.size() * sizeof(float)) == 0;
}

void expect_same_bits(const Image& a, const Image& b) {
  EXPECT_EQ(a.window, b.window);
  EXPECT_EQ(a.samples, b.samples);
  EXPECT_TRUE(same_bits(a.rgb, b.rgb));
  EXPECT_TRUE(same_bits(a.variance, b.variance));
}

TEST(Determinism, NumberOfThreads) {
  const Image one = render_function(reference_settings, 1);
  expect_same_bits(one, render_function(reference_settings, 2));
  expect_same_bits(one, render_function(reference_settings, 7));
}

TEST(Determinism, TileSizeAndOrder) {
  const Image reference = render_function(reference_settings, 2);
  for (const int32_t size : {8, 16, 32, 64, 128}) {
    for (const TileOrder order : {TileOrder::scan, TileOrder::spiral}) {
      RenderSettings settings = reference_settings;
      settings.tile_size = size;
      settings.tile_order = order;
      expect_same_bits(reference, render_function(settings, 2));
      settings.first_region = scene::Window{40, 20, 10, 10};
      expect_same_bits(reference, render_function(settings, 2));
    }
  }
}

TEST(Determinism, SeedMatters) {
  RenderSettings settings = reference_settings;
  settings.seed = 1;
  EXPECT_FALSE(same_bits(render_function(reference_settings, 2).rgb, render_function(settings, 2).rgb));
}

TEST(Determinism, CropHasThePixelsOfTheWholeFilm) {
  const Image whole = render_function(reference_settings, 2);
  RenderSettings settings = reference_settings;
  settings.film.crop = {13, 7, 33, 29};
  const Image crop = render_function(settings, 2);
  EXPECT_EQ(crop.window, settings.film.crop);
  EXPECT_EQ(crop.full_width, 83);
  EXPECT_EQ(crop.full_height, 57);
  for (int32_t y = 0; y < crop.window.height; ++y) {
    const auto row = static_cast<size_t>(y) * 33 * 3;
    const auto row_of_whole = (static_cast<size_t>(y + 7) * 83 + 13) * 3;
    // Bits are what is promised.
    // NOLINTNEXTLINE(bugprone-suspicious-memory-comparison)
    EXPECT_EQ(std::memcmp(&crop.rgb[row], &whole.rgb[row_of_whole], 33 * 3 * sizeof(float)), 0)
        << "row " << y;
    // NOLINTNEXTLINE(bugprone-suspicious-memory-comparison)
    EXPECT_EQ(std::memcmp(&crop.variance[row], &whole.variance[row_of_whole], 33 * 3 * sizeof(float)), 0);
  }
}

// A job splits 64 samples into passes, by tile size into different ones; summing each pixel's samples in one
// go must come to the same bits.
TEST(Determinism, SplitIntoPasses) {
  const RenderSettings settings = small_settings(19, 17, 64);
  const Image image = render_function(settings, 2);
  const auto integrator = function_integrator(ray_and_random_function);
  for (uint32_t y = 0; y < 17; ++y) {
    for (uint32_t x = 0; x < 19; ++x) {
      PixelSums sums;
      for (uint32_t sample = 0; sample < 64; ++sample) {
        RandomStream random(settings.seed, x, y, sample);
        const Ray ray = FilmCamera(settings.sensor, settings.film).sample(x, y, random);
        RayCounters counters;
        sums.add(sample, integrator->sample(ray, random, counters).sampled);
      }
      for (int channel = 0; channel < 3; ++channel) {
        EXPECT_EQ(image.rgb[(y * 19 + x) * 3 + static_cast<uint32_t>(channel)],
                  to_pixel(sums.mean({0, 64})[channel]));
      }
    }
  }
}

// The tiles, read one by one, are the image.
TEST(Determinism, TilesAreTheImage) {
  RenderJob job(function_integrator(ray_and_random_function), reference_settings);
  run_to_completion(job, 2);
  const Image image = job.image();
  for (uint32_t index = 0; index < job.tile_count(); ++index) {
    const TilePixels tile = job.tile(index);
    EXPECT_EQ(tile.samples, 11u);
    for (int32_t y = 0; y < tile.window.height; ++y) {
      const auto width = static_cast<size_t>(tile.window.width);
      const size_t row_of_image =
          (static_cast<size_t>(tile.window.y + y) * 83 + static_cast<size_t>(tile.window.x)) * 3;
      EXPECT_EQ(std::memcmp(&tile.rgb[static_cast<size_t>(y) * width * 3], &image.rgb[row_of_image],
                            width * 3 * sizeof(float)),
                0);
    }
  }
}

}  // namespace
}  // namespace fogbank::render
