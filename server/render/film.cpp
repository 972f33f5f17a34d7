#include "render/film.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>
#include <utility>

namespace fogbank::render {

namespace {

/// Root mean square of what an edge that Epanechnikov's kernel blurs is off by, by that of the difference to
/// half the radius: with F(u) = 1 / 2 + 3 u / 4 - u^3 / 4, the kernel's integral, the root of the ratio of
/// the integrals of (1 - F(u))^2 and (F(min(2 u, 1)) - F(u))^2 over u in [0, 1]. Where bias grows with the
/// radius, as it does at walls in the mean over many places, the ratio is 2; where it grows with the square,
/// 4 / 3.
constexpr double blur_factor = 2.12;

}  // namespace

double luminance_of(const Vec3d& rgb) { return 0.212671 * rgb.x + 0.715160 * rgb.y + 0.072169 * rgb.z; }

namespace {

/// Of all samples, that look at the cache: what their noise is known from.
constexpr double least_share_of_cached_samples = 1.0 / 16;

/// As `relative_disagreement` says, of the errors of pixels that `error_of(tile, pixel)` gives.
template <typename ErrorOf>
double relative_disagreement_of(const std::vector<const TileFilm*>& tiles, const ErrorOf& error_of) {
  const double mean = mean_luminance(tiles);
  if (!(mean > 0)) return 0;
  std::vector<float> squares;
  for (const TileFilm* tile : tiles) {
    for (size_t pixel = 0; pixel < tile->sampled.size(); ++pixel) {
      const double error = luminance_of(error_of(*tile, pixel));
      const double scale = luminance_of(tile->mean(pixel)) + 0.1 * mean;
      squares.push_back(to_pixel(sqr(static_cast<float>(error / scale))));
    }
  }
  return std::sqrt(trimmed_mean(std::move(squares)));
}

}  // namespace

Vec3d PixelSums::mean(SampleCounts samples) const {
  return samples.sum() == 0 ? Vec3d(0) : (even + odd) / static_cast<double>(samples.sum());
}

Vec3d PixelSums::standard_error(SampleCounts samples) const {
  if (samples.even == 0 || samples.odd == 0) return Vec3d(0);
  const double even_count = samples.even;
  const double odd_count = samples.odd;
  return (even / even_count - odd / odd_count) * (std::sqrt(even_count * odd_count) / samples.sum());
}

Vec3d TileFilm::mean(size_t pixel) const {
  const Vec3d mean = sampled[pixel].mean(all_samples());
  return cached.empty() ? mean : mean + cached[pixel].mean(cached_samples);
}

Vec3d TileFilm::standard_error(size_t pixel) const {
  const Vec3d error = sampled[pixel].standard_error(all_samples());
  return cached.empty() ? error : error + cached[pixel].standard_error(cached_samples);
}

float to_pixel(double value) {
  if (std::fabs(value) < static_cast<double>(std::numeric_limits<float>::min())) return 0.0f;
  constexpr auto largest = static_cast<double>(std::numeric_limits<float>::max());
  return static_cast<float>(std::clamp(value, -largest, largest));
}

double mean_luminance(const std::vector<const TileFilm*>& tiles) {
  double sum = 0;
  size_t count = 0;
  for (const TileFilm* tile : tiles) {
    for (size_t pixel = 0; pixel < tile->sampled.size(); ++pixel) sum += luminance_of(tile->mean(pixel));
    count += tile->sampled.size();
  }
  return sum / static_cast<double>(count);
}

double trimmed_mean(std::vector<float> values) {
  const size_t kept = values.size() - values.size() / 1000;
  std::nth_element(values.begin(), values.begin() + static_cast<std::ptrdiff_t>(kept - 1), values.end());
  double total = 0;
  for (size_t i = 0; i < kept; ++i) total += static_cast<double>(values[i]);
  return total / static_cast<double>(kept);
}

double relative_disagreement(const std::vector<const TileFilm*>& tiles) {
  return relative_disagreement_of(
      tiles, [](const TileFilm& tile, size_t pixel) { return tile.standard_error(pixel); });
}

double wanted_share_of_cached_samples(const std::vector<const TileFilm*>& tiles) {
  const TileFilm& first = *tiles.front();
  if (first.cached_samples.even < 2 || first.cached_samples.odd < 2) return 1;
  const double sampled =
      relative_disagreement_of(tiles,
                               [](const TileFilm& tile, size_t pixel) {
                                 return tile.sampled[pixel].standard_error(tile.all_samples());
                               }) *
      std::sqrt(first.samples);
  const double cached =
      relative_disagreement_of(tiles,
                               [](const TileFilm& tile, size_t pixel) {
                                 return tile.cached[pixel].standard_error(tile.cached_samples);
                               }) *
      std::sqrt(first.cached_samples.sum());
  return cached < sampled ? std::fmax(cached / sampled, least_share_of_cached_samples) : 1;
}

double relative_blur(const std::vector<const TileFilm*>& tiles) {
  const double mean = mean_luminance(tiles);
  if (!(mean > 0)) return 0;
  std::vector<double> squares;
  for (const TileFilm* tile : tiles) {
    const SampleCounts samples = tile->all_samples();
    if (tile->narrow.empty() || samples.even == 0 || samples.odd == 0) return 0;
    for (size_t pixel = 0; pixel < tile->sampled.size(); ++pixel) {
      const PixelSums& wide = tile->sampled[pixel];
      const PixelSums& narrow = tile->narrow[pixel];
      const PixelSums difference{wide.even - narrow.even, wide.odd - narrow.odd};
      const double bias = blur_factor * luminance_of(difference.mean(samples));
      const double error = blur_factor * luminance_of(difference.standard_error(samples));
      const double scale = luminance_of(wide.mean(samples)) + 0.1 * mean;
      squares.push_back((bias * bias - error * error) / (scale * scale));
    }
  }
  // Without the 0.1 % that are the furthest from 0, as single fireflies would decide it otherwise.
  const auto kept = static_cast<std::ptrdiff_t>(squares.size() - squares.size() / 1000);
  std::nth_element(squares.begin(), squares.begin() + (kept - 1), squares.end(),
                   [](double a, double b) { return std::fabs(a) < std::fabs(b); });
  const auto count = static_cast<double>(kept);
  const double sum = std::accumulate(squares.begin(), squares.begin() + kept, 0.0);
  const double sum_of_squares =
      std::inner_product(squares.begin(), squares.begin() + kept, squares.begin(), 0.0);
  const double average = sum / count;
  const double variance = std::fmax(sum_of_squares / count - average * average, 0.0);
  return std::sqrt(std::fmax(average, std::sqrt(variance / count)));
}

}  // namespace fogbank::render
