// Sums of radiance samples, in two layers: what random numbers alone decide, and what the cache's epoch
// decides, which begins anew with each epoch. A third one holds what samples that are blurred would be with
// less blur, for the estimate of their error. Memory: 48 bytes a pixel and layer; the second and third layer
// exist only where an integrator prepares something, or blurs. A tile whose pass isn't finished yet is kept
// as it was before, too (render_job.cpp), which makes it 96 bytes a pixel, or 192 with two layers; a
// checkpoint that is being written may hold a third one.
#pragma once

#include <bit>
#include <cstdint>
#include <vector>

#include "core/vector.h"

namespace fogbank::render {

/// Which half of the samples a sample is in. Samples of a pixel are spread by Sobol' sequences
/// (core/sobol.h), whose first digits are parities of some of the index's binary digits: halves that were
/// told apart by one of those would be the two sides of the pixel or of a light, and differ for ever. These
/// are told apart by the first digit of one more dimension (the fourth: polynomial x^3 + x + 1, first numbers
/// 1, 3, 1; Joe and Kuo 2008), so that from 16 samples on each half is spread well by itself. Numbers that
/// differ in the last binary digit only are in different halves.
inline bool is_odd_sample(uint32_t sample) {
  constexpr uint32_t digits = 0x53u | 0x53u << 7 | 0x53u << 14 | 0x53u << 21 | 0x53u << 28;
  return std::popcount(sample & digits) % 2 != 0;
}

/// Samples of the first and of the second half (PixelSums).
struct SampleCounts {
  uint32_t even = 0;
  uint32_t odd = 0;

  /// Of sample indices [first, end).
  static SampleCounts of_range(uint32_t first, uint32_t end) {
    const uint32_t odd = odd_below(end) - odd_below(first);
    return {end - first - odd, odd};
  }
  uint32_t sum() const { return even + odd; }
  SampleCounts& operator+=(const SampleCounts& more) {
    even += more.even;
    odd += more.odd;
    return *this;
  }
  bool operator==(const SampleCounts&) const = default;

 private:
  static uint32_t odd_below(uint32_t n) { return n / 2 + (n % 2 != 0 && is_odd_sample(n - 1) ? 1 : 0); }
};

/// Samples of one pixel in two halves. Their difference overestimates the noise where the sequences that the
/// samples follow do better than independent samples. Doubles: with 2^20 samples a sum of floats would lose
/// what the last samples add. Always summed in the order of the sample index, hence a function of the samples
/// alone.
struct PixelSums {
  Vec3d even{0};
  Vec3d odd{0};

  void add(uint32_t sample, const Spectrum& radiance) {
    (is_odd_sample(sample) ? odd : even) += Vec3d(radiance);
  }
  Vec3d mean(SampleCounts samples) const;
  /// Difference of the two halves' means, scaled so that its square estimates, without bias where samples
  /// are independent, the variance of `mean`: with a and b samples of variance v each, E[(A - B)^2] = v (1 /
  /// a + 1 / b), and the variance of the mean is v / (a + b); so the scale is sqrt(a b) / (a + b). 0 where a
  /// half is empty.
  Vec3d standard_error(SampleCounts samples) const;
};

/// Those that a film may have besides the first.
struct FilmLayers {
  bool cached = false;
  bool narrow = false;
};

/// One tile after some number of passes; row by row.
struct TileFilm {
  uint32_t passes = 0;
  uint32_t samples = 0;              ///< per pixel
  std::vector<PixelSums> sampled;    ///< of all samples; of both parts where `cached` is empty
  uint32_t first_cached_sample = 0;  ///< the first of the present epoch
  SampleCounts cached_samples;       ///< since then, not all have looked at the cache
  std::vector<PixelSums> cached;     ///< of these
  std::vector<PixelSums> narrow;  ///< PixelSample::narrow of all samples, or empty; not part of the picture

  SampleCounts all_samples() const { return SampleCounts::of_range(0, samples); }
  Vec3d mean(size_t pixel) const;
  /// The layers' errors added with their signs: samples that are in both layers are correlated, and the
  /// square of the sum has the right mean then, too, also where one layer has only some of the other's.
  Vec3d standard_error(size_t pixel) const;
};

/// As a float that is finite and not denormal: what a thread makes of denormals depends on its mode (render
/// threads flush them, others don't), and pixels must not.
float to_pixel(double value);

double luminance_of(const Vec3d& rgb);

/// Over all pixels of `tiles`, at least one.
double mean_luminance(const std::vector<const TileFilm*>& tiles);

/// Without the largest 0.1 % of them; at least one.
double trimmed_mean(std::vector<float> values);

/// How much the half buffers of an image disagree, as a share of its brightness: the noise of independent
/// samples. With L the mean luminance of a pixel, V its variance from
/// the half buffers and M the mean of L over the image: the root mean square of sqrt(V) / (L + M / 10) over
/// the pixels, without the largest 0.1 % of them, as single fireflies would decide it otherwise. `tiles` hold
/// the same samples each. 0 with one sample or a black image. Takes about 20 ns a pixel.
double relative_disagreement(const std::vector<const TileFilm*>& tiles);

/// The share of samples that are to look at the cache, in (0, 1]: with the same time for either layer's
/// samples, the least variance of the sum is where they go as the layers' noise of one sample. 1 where that
/// is not known: where a layer has but one sample in either half, or none has noise.
double wanted_share_of_cached_samples(const std::vector<const TileFilm*>& tiles);

/// What blur adds to the error of an image, in the same measure. A pixel is taken to be off by what it would
/// be in an edge (film.cpp), given the difference D to its mean with half the radius: 2.12 D. The square of
/// that is estimated with the variance from the half buffers taken off, which may make it negative in a
/// pixel. The result is at least what could be told from noise, the standard error of the mean over the
/// pixels: nothing found isn't no bias. Of features narrower than the radius too little is found. 0 where
/// films have no narrow layer, with one sample, or for a black image.
double relative_blur(const std::vector<const TileFilm*>& tiles);

}  // namespace fogbank::render
