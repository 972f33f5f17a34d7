// Sums of radiance samples. Memory: 48 bytes a pixel; a tile whose pass isn't finished yet is kept as it was
// before, too (render_job.cpp), which makes it 96.
#pragma once

#include <cstdint>
#include <vector>

#include "core/vector.h"

namespace fogbank::render {

/// Samples of one pixel in two halves, by even and odd sample index. Doubles: with 2^20 samples a sum of
/// floats would lose what the last samples add. Always summed in the order of the sample index, hence a
/// function of the number of samples alone.
struct PixelSums {
  Vec3d even{0};
  Vec3d odd{0};

  void add(uint32_t sample, const Spectrum& radiance) { (sample % 2 == 0 ? even : odd) += Vec3d(radiance); }
  Vec3d mean(uint32_t samples) const;
  /// Difference of the two halves' means, scaled so that its square estimates, without bias, the variance of
  /// `mean`: with a and b samples of variance v each, E[(A - B)^2] = v (1 / a + 1 / b), and the variance of
  /// the mean is v / (a + b); so the scale is sqrt(a b) / (a + b). 0 with less than two samples.
  Vec3d standard_error(uint32_t samples) const;
};

/// One tile after some number of passes; row by row.
struct TileFilm {
  uint32_t passes = 0;
  uint32_t samples = 0;  ///< per pixel
  std::vector<PixelSums> pixels;
};

/// As a float that is finite and not denormal: what a thread makes of denormals depends on its mode (render
/// threads flush them, others don't), and pixels must not.
float to_pixel(double value);

/// The formula is at `RenderJob::relative_noise`; `tiles` hold the same number of samples each. 0 with one
/// sample or a black image.
double relative_noise(const std::vector<const TileFilm*>& tiles);

}  // namespace fogbank::render
