#include "render/error_estimate.h"

#include <algorithm>
#include <cmath>
#include <utility>

namespace fogbank::render {

namespace {

constexpr int32_t box_radius = 2;
/// Added to the squared mean of the reference: keeps black pixels from deciding.
constexpr double darkest_square = 1e-2;

/// Pixels inside `crop` (coordinates from its corner) that are at most `box_radius` away in either direction.
scene::Window box_around(int32_t x, int32_t y, const scene::Window& crop) {
  const int32_t left = std::max(x - box_radius, 0);
  const int32_t top = std::max(y - box_radius, 0);
  return {left, top, std::min(x + box_radius, crop.width - 1) - left + 1,
          std::min(y + box_radius, crop.height - 1) - top + 1};
}

template <typename Function>
void for_each_pixel(const scene::Window& window, const Function& function) {
  for (int32_t y = window.y; y < window.y + window.height; ++y) {
    for (int32_t x = window.x; x < window.x + window.width; ++x) function(x, y);
  }
}

}  // namespace

Vec3d PassImage::mean(int32_t x, int32_t y) const {
  const auto [tile, pixel] = grid.locate(x, y);
  return tiles[tile]->mean(pixel);
}

double relative_bias(const PassImage& image, const scene::Window& crop, const CacheSurvey& survey) {
  const double mean = mean_luminance(image.tiles);
  if (!(mean > 0)) return 0;
  std::vector<float> squares;
  squares.reserve(size_t{survey.rows()} * survey.columns());
  for (uint32_t row = 0; row < survey.rows(); ++row) {
    for (uint32_t column = 0; column < survey.columns(); ++column) {
      const scene::Window box = box_around(survey.x(column) - crop.x, survey.y(row) - crop.y, crop);
      double sum = 0;
      for_each_pixel(box, [&](int32_t x, int32_t y) { sum += luminance_of(image.mean(x, y)); });
      const double scale = sum / (box.width * box.height) + 0.1 * mean;
      const size_t index = size_t{row} * survey.columns() + column;
      const auto variance = static_cast<double>(survey.values(0)[index]);
      const auto bias = static_cast<double>(survey.values(1)[index]);
      squares.push_back(to_pixel((bias * bias + variance) / (scale * scale)));
    }
  }
  return std::sqrt(trimmed_mean(std::move(squares)));
}

ReferenceComparison::ReferenceComparison(std::shared_ptr<const ReferenceImage> reference)
    : reference_(std::move(reference)), scales_(reference_->rgb.size()) {
  const scene::Window& window = reference_->window;
  const auto width = static_cast<size_t>(window.width);
  const std::vector<float>& rgb = reference_->rgb;
  double sum_of_luminances = 0;
  for (size_t i = 0; i < rgb.size(); i += 3) {
    sum_of_luminances += luminance_of(Vec3d(rgb[i], rgb[i + 1], rgb[i + 2]));
  }
  mean_luminance_ = sum_of_luminances / (static_cast<double>(rgb.size()) / 3);
  for (int32_t y = 0; y < window.height; ++y) {
    for (int32_t x = 0; x < window.width; ++x) {
      const scene::Window box = box_around(x, y, window);
      Vec3d sum(0);
      for_each_pixel(box, [&](int32_t u, int32_t v) {
        const size_t first = (static_cast<size_t>(v) * width + static_cast<size_t>(u)) * 3;
        sum += Vec3d(rgb[first], rgb[first + 1], rgb[first + 2]);
      });
      const Vec3d mean = sum / static_cast<double>(box.width * box.height);
      float* const scale = &scales_[(static_cast<size_t>(y) * width + static_cast<size_t>(x)) * 3];
      for (int c = 0; c < 3; ++c) scale[c] = static_cast<float>(1 / (mean[c] * mean[c] + darkest_square));
    }
  }
}

TrueError ReferenceComparison::compare(const PassImage& image) const {
  const scene::Window& window = reference_->window;
  std::vector<float> squares;
  std::vector<float> relative;
  squares.reserve(scales_.size() / 3);
  relative.reserve(scales_.size() / 3);
  for_each_pixel({0, 0, window.width, window.height}, [&](int32_t x, int32_t y) {
    const size_t first = squares.size() * 3;
    const Vec3d wanted(reference_->rgb[first], reference_->rgb[first + 1], reference_->rgb[first + 2]);
    const Vec3d difference = image.mean(x, y) - wanted;
    double sum = 0;
    for (int c = 0; c < 3; ++c) {
      sum += difference[c] * difference[c] * static_cast<double>(scales_[first + static_cast<size_t>(c)]);
    }
    squares.push_back(to_pixel(sum / 3));
    const double wrong = std::fabs(luminance_of(difference));
    relative.push_back(wrong > 0 ? to_pixel(wrong / (luminance_of(wanted) + 0.1 * mean_luminance_)) : 0.0f);
  });
  const auto percentile = [&](double share) {
    const double index = std::floor(share * static_cast<double>(relative.size() - 1));
    const auto nth = relative.begin() + static_cast<std::ptrdiff_t>(index);
    std::nth_element(relative.begin(), nth, relative.end());
    return static_cast<double>(*nth);
  };
  TrueError error;
  error.relative_mse = trimmed_mean(std::move(squares));
  error.median = percentile(0.5);
  error.percentile_99 = percentile(0.99);
  for (float& value : relative) value = to_pixel(static_cast<double>(value) * static_cast<double>(value));
  error.relative_error = std::sqrt(trimmed_mean(std::move(relative)));
  return error;
}

}  // namespace fogbank::render
