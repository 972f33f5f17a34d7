#include "render/film.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace fogbank::render {

namespace {

double luminance_of(const Vec3d& rgb) { return 0.212671 * rgb.x + 0.715160 * rgb.y + 0.072169 * rgb.z; }

}  // namespace

Vec3d PixelSums::mean(SampleRange samples) const {
  return samples.count() == 0 ? Vec3d(0) : (even + odd) / static_cast<double>(samples.count());
}

Vec3d PixelSums::standard_error(SampleRange samples) const {
  const double even_count = samples.even_count();
  const double odd_count = samples.odd_count();
  if (even_count == 0 || odd_count == 0) return Vec3d(0);
  return (even / even_count - odd / odd_count) * (std::sqrt(even_count * odd_count) / samples.count());
}

Vec3d TileFilm::mean(size_t pixel) const {
  const Vec3d mean = sampled[pixel].mean(all_samples());
  return cached.empty() ? mean : mean + cached[pixel].mean(cached_samples());
}

Vec3d TileFilm::standard_error(size_t pixel) const {
  const Vec3d error = sampled[pixel].standard_error(all_samples());
  return cached.empty() ? error : error + cached[pixel].standard_error(cached_samples());
}

float to_pixel(double value) {
  if (std::fabs(value) < static_cast<double>(std::numeric_limits<float>::min())) return 0.0f;
  constexpr auto largest = static_cast<double>(std::numeric_limits<float>::max());
  return static_cast<float>(std::clamp(value, -largest, largest));
}

double relative_noise(const std::vector<const TileFilm*>& tiles) {
  double sum = 0;
  size_t count = 0;
  for (const TileFilm* tile : tiles) {
    for (size_t pixel = 0; pixel < tile->sampled.size(); ++pixel) sum += luminance_of(tile->mean(pixel));
    count += tile->sampled.size();
  }
  if (!(sum > 0)) return 0;
  const double offset = 0.1 * sum / static_cast<double>(count);

  std::vector<float> squares;
  squares.reserve(count);
  for (const TileFilm* tile : tiles) {
    for (size_t pixel = 0; pixel < tile->sampled.size(); ++pixel) {
      const double error = luminance_of(tile->standard_error(pixel));
      const double scale = luminance_of(tile->mean(pixel)) + offset;
      squares.push_back(to_pixel(sqr(static_cast<float>(error / scale))));
    }
  }
  const size_t kept = count - count / 1000;
  std::nth_element(squares.begin(), squares.begin() + static_cast<std::ptrdiff_t>(kept - 1), squares.end());
  double total = 0;
  for (size_t i = 0; i < kept; ++i) total += static_cast<double>(squares[i]);
  return std::sqrt(total / static_cast<double>(kept));
}

}  // namespace fogbank::render
