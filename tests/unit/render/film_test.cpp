#include "render/film.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>

#include "function_integrator.h"

namespace fogbank::render {
namespace {

struct Moments {
  double mean = 0;
  double variance_estimate = 0;
};

// Of an image whose samples are uniform in [0, 1): mean 1/2, variance of one sample 1/12.
Moments uniform_image(int32_t samples) {
  const Image image = render_function(
      small_settings(128, 128, samples), 2,
      [](const Ray&, RandomStream& random, RayCounters&) { return Spectrum(random.next_float()); });
  Moments moments;
  for (size_t i = 0; i < image.rgb.size(); i += 3) {
    moments.mean += static_cast<double>(image.rgb[i]) / (128.0 * 128.0);
    moments.variance_estimate += static_cast<double>(image.variance[i]) / (128.0 * 128.0);
  }
  return moments;
}

// Odd numbers make halves of different size.
class HalfBuffers : public testing::TestWithParam<int32_t> {};

TEST_P(HalfBuffers, EstimateTheVarianceOfTheMean) {
  const Moments moments = uniform_image(GetParam());
  const double variance = 1.0 / 12.0 / GetParam();
  constexpr double pixels = 128.0 * 128.0;
  // 4.42 standard errors: two-sided p = 1e-5. The square of a normal variable of variance v has variance 2
  // v^2; sums of uniform variables have lighter tails, hence less.
  EXPECT_NEAR(moments.mean, 0.5, 4.42 * std::sqrt(variance / pixels));
  EXPECT_NEAR(moments.variance_estimate, variance, 4.42 * variance * std::sqrt(2.0 / pixels));
}

INSTANTIATE_TEST_SUITE_P(SampleCounts, HalfBuffers, testing::Values(2, 3, 7, 16));

TEST(Film, OneSampleHasNoVariance) {
  EXPECT_EQ(uniform_image(1).variance_estimate, 0.0);
  EXPECT_EQ(PixelSums{}.mean({0, 0}), Vec3d(0));
}

TEST(Film, HalvesOfARange) {
  for (uint32_t first = 0; first < 70; ++first) {
    for (uint32_t end = first; end < 140; ++end) {
      PixelSums sums;
      for (uint32_t i = first; i < end; ++i) sums.add(i, Spectrum(1));
      const SampleCounts range = SampleCounts::of_range(first, end);
      ASSERT_EQ(sums.even.x, range.even) << first << " " << end;
      ASSERT_EQ(sums.odd.x, range.odd) << first << " " << end;
      ASSERT_LE(std::fabs(sums.even.x - sums.odd.x), 2);
    }
  }
}

// An edge through the pixels: the samples are spread evenly over both sides, so the noise falls faster than
// by the root of the number of samples. Halves that were the two sides themselves would never agree.
TEST(Film, NoiseOfAnEdgeFalls) {
  const auto noise = [](int32_t samples, int axis) {
    RenderSettings settings = small_settings(64, 64, samples);
    settings.sensor.kind = scene::SensorKind::orthographic;
    RenderJob job(function_integrator([axis](const Ray& ray, RandomStream&, RayCounters&) {
                    const float pixels = 32 * ray.origin[axis];  // the film is 2 wide
                    return Spectrum(pixels - std::floor(pixels) < 0.4f ? 1.0f : 0.0f);
                  }),
                  settings);
    run_to_completion(job, 2);
    return job.progress().estimate.noise.value();
  };
  // Independent samples would have a quarter.
  for (int axis = 0; axis < 2; ++axis) EXPECT_LT(noise(256, axis), noise(16, axis) / 5);
}

// The samples of a pixel are spread better than its halves would be if they were independent: their
// disagreement tells of too much noise, what is made of it doesn't.
TEST(Film, NoiseOfSpreadSamples) {
  constexpr float share = 0.4f;
  RenderSettings settings = small_settings(64, 64, 64);
  settings.error = 1e-6;
  settings.sensor.kind = scene::SensorKind::orthographic;
  RenderJob job(function_integrator([](const Ray& ray, RandomStream&, RayCounters&) {
                  const float pixels = 32 * ray.origin.x;  // the film is 2 wide
                  return Spectrum(pixels - std::floor(pixels) < share ? 1.0f : 0.0f);
                }),
                settings);
  run_to_completion(job, 2);
  double square = 0;
  const Image image = job.image();
  for (const float value : image.rgb) square += sqr(static_cast<double>(value - share));
  const double error =
      std::sqrt(square / static_cast<double>(image.rgb.size())) / static_cast<double>(1.1f * share);
  const ErrorEstimate estimate = job.progress().estimate;
  // The halves are spread less well than as many samples of the sequence itself, so it stays above the error.
  EXPECT_GT(estimate.disagreement, 2 * error);
  EXPECT_GT(estimate.noise.value(), error);
}

TEST(Film, SumsDoNotLoseSmallSamples) {
  PixelSums sums;
  sums.add(0, Spectrum(1e9f));
  constexpr uint32_t samples = 1u << 20;
  for (uint32_t i = 1; i < samples; ++i) sums.add(i, Spectrum(1.0f));
  EXPECT_DOUBLE_EQ(sums.mean(SampleCounts::of_range(0, samples)).x, (1e9 + samples - 1) / samples);
}

TEST(Film, PixelsAreFiniteAndNotDenormal) {
  EXPECT_EQ(to_pixel(1e-42), 0.0f);
  EXPECT_EQ(to_pixel(1e300), std::numeric_limits<float>::max());
  EXPECT_EQ(to_pixel(0.1), 0.1f);
  // The square of the largest float is beyond it.
  const Image image =
      render_function(small_settings(8, 8, 4), 1, [](const Ray&, RandomStream& random, RayCounters&) {
        return Spectrum(random.next_float() < 0.5f ? std::numeric_limits<float>::max() : 0.0f);
      });
  for (const float value : image.variance) EXPECT_TRUE(std::isfinite(value));
}

TEST(Film, InvalidSamplesAreBlackAndCounted) {
  constexpr float bad[] = {std::numeric_limits<float>::quiet_NaN(), std::numeric_limits<float>::infinity(),
                           -1.0f};
  for (const float value : bad) {
    RenderJob job(function_integrator([&](const Ray&, RandomStream& random, RayCounters&) {
                    return random.next_float() < 0.25f ? Spectrum(1, value, 1) : Spectrum(1);
                  }),
                  small_settings(16, 16, 8));
    run_to_completion(job, 2);
    const Image image = job.image();
    double sum = 0;
    for (size_t i = 0; i < image.rgb.size(); ++i) {
      ASSERT_TRUE(std::isfinite(image.rgb[i]) && std::isfinite(image.variance[i]));
      sum += static_cast<double>(image.rgb[i]);
    }
    const uint64_t invalid = job.progress().invalid_samples;
    EXPECT_GT(invalid, 0u);
    // Sums of ones are exact.
    EXPECT_EQ(sum * 8, 3.0 * static_cast<double>(16 * 16 * 8 - invalid));
  }
}

TEST(RelativeNoise, FollowsItsFormula) {
  RenderJob job(function_integrator([](const Ray&, RandomStream& random, RayCounters&) {
                  return Spectrum(random.next_float());
                }),
                small_settings(128, 128, 64));
  EXPECT_FALSE(job.progress().estimate.noise.has_value());
  run_to_completion(job, 2);
  // L = M = 1/2 but for the noise: sqrt(1 / 12 / 64) / (0.5 + 0.05). Without the largest 0.1 % the sum of
  // squares of normal variables lacks 1.2 % (0.6 % of the root); the rest is the statistical error of the
  // root, 4.42 / sqrt(2 * 16384) = 2.4 %, and the noise in L itself, which is second order.
  EXPECT_NEAR(job.progress().estimate.noise.value(), std::sqrt(1.0 / 12 / 64) / 0.55, 0.035 * 0.0657);
}

TEST(RelativeNoise, IsNotDecidedByFireflies) {
  // Every pixel has the mean 1. The standard error is 1/8 but in the few fireflies, where it is 1.
  const auto noise = [](size_t fireflies) {
    TileFilm tile;
    tile.samples = 2;
    tile.sampled.resize(16384);
    for (size_t i = 0; i < tile.sampled.size(); ++i) {
      const float error = i < fireflies ? 1.0f : 0.125f;
      tile.sampled[i].add(0, Spectrum(1 + error));
      tile.sampled[i].add(1, Spectrum(1 - error));
    }
    return relative_disagreement({&tile});
  };
  // 1e-6: the squares are floats.
  EXPECT_NEAR(noise(0), 0.125 / 1.1, 1e-6);
  EXPECT_NEAR(noise(16), 0.125 / 1.1, 1e-6) << "0.1 % of the pixels";
  EXPECT_NEAR(noise(116), std::sqrt((100.0 + 16268 * 0.125 * 0.125) / 16368) / 1.1, 1e-6);
}

TEST(RelativeNoise, BlackImageHasNone) {
  RenderJob job(function_integrator([](const Ray&, RandomStream&, RayCounters&) { return Spectrum(0); }),
                small_settings(16, 16, 4));
  run_to_completion(job, 1);
  EXPECT_FALSE(job.progress().estimate.noise.has_value());
}

TEST(RelativeBlur, FollowsItsFormula) {
  // Samples of mean `wide`, with half the radius `narrow`, and independent noise in both.
  const auto blur = [](float wide, float narrow, float noise) {
    TileFilm tile;
    tile.samples = 16;
    tile.sampled.resize(65536);
    tile.narrow.resize(65536);
    for (uint32_t pixel = 0; pixel < 65536; ++pixel) {
      RandomStream random(0, pixel, 0, 0);
      for (uint32_t sample = 0; sample < 16; ++sample) {
        tile.sampled[pixel].add(sample, Spectrum(wide + noise * (random.next_float() - 0.5f)));
        tile.narrow[pixel].add(sample, Spectrum(narrow + noise * (random.next_float() - 0.5f)));
      }
    }
    return relative_blur({&tile});
  };
  EXPECT_NEAR(blur(1.1f, 1.05f, 0), 2.12 * 0.05 / (1.1 * 1.1), 1e-6);
  EXPECT_NEAR(blur(1.05f, 1.1f, 0), 2.12 * 0.05 / (1.1 * 1.05), 1e-6) << "in either direction";
  // 2.12 times a difference of two means of 16 samples of variance 0.09 / 12 has the standard deviation s =
  // 0.065. The square of a normal variable less an estimate of its variance with one degree of freedom has
  // the standard deviation 2 s^2 = 0.0085; of the mean of 65536 of them, 4.42 standard errors are 1.3 % of
  // 0.106^2. A pixel that is too bright by chance has a greater difference, but counts for less: the
  // covariance takes 4 D v / L, v the variance of the pixel, from a square of D^2: 3 %. Half of both of the
  // root.
  EXPECT_NEAR(blur(1.1f, 1.05f, 0.3f), 2.12 * 0.05 / (1.1 * 1.1), 0.022 * 0.0876);
  EXPECT_EQ(blur(0, 0, 0), 0);
}

TEST(RelativeBlur, OfAnEdge) {
  // A step of 1 in a brightness of 100, blurred with the radius of 400 pixels amid as many of either side:
  // Epanechnikov's kernel, whose integral is F.
  const auto blurred = [](double distance) {
    const double u = std::clamp(distance, -1.0, 1.0);
    return 100.5 + 0.75 * u - 0.25 * u * u * u;
  };
  TileFilm tile;
  tile.samples = 2;
  tile.sampled.resize(2000);
  tile.narrow.resize(2000);
  double squares = 0;
  for (size_t pixel = 0; pixel < 2000; ++pixel) {
    const double distance = (static_cast<double>(pixel) - 999.5) / 400;
    for (const uint32_t sample : {0u, 1u}) {
      tile.sampled[pixel].add(sample, Spectrum(static_cast<float>(blurred(distance))));
      tile.narrow[pixel].add(sample, Spectrum(static_cast<float>(blurred(2 * distance))));
    }
    const double off = blurred(distance) - (distance > 0 ? 101.0 : 100.0);
    squares += off * off / 2000;
  }
  // Brightness differs by 0.5 % to either side of the mean; the factor has three digits.
  EXPECT_NEAR(relative_blur({&tile}), std::sqrt(squares) / (1.1 * 100.5), 0.01 * std::sqrt(squares) / 110);
}

TEST(RelativeBlur, IsNotKnownOfOneSample) {
  TileFilm tile;
  tile.samples = 1;
  tile.sampled.resize(4);
  tile.narrow.resize(4);
  for (PixelSums& pixel : tile.sampled) pixel.add(0, Spectrum(1));
  EXPECT_EQ(relative_blur({&tile}), 0);
}

}  // namespace
}  // namespace fogbank::render
