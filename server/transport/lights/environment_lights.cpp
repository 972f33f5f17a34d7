#include "transport/lights/environment_lights.h"

#include <algorithm>

#include "core/sampling.h"

namespace fogbank::transport {

std::optional<LightSample> ConstantLight::sample(const Vec3f&, const Vec2f& u) const {
  return LightSample{square_to_uniform_sphere(u), infinity, radiance_, inv_4pi};
}

namespace {

/// Cell of a cumulative distribution with `count` cells, and the position within it.
int32_t find_cell(const float* cdf, int32_t count, float& u) {
  const auto* above = std::upper_bound(cdf, cdf + count + 1, u);
  const int32_t cell = std::clamp(static_cast<int32_t>(above - cdf) - 1, 0, count - 1);
  const float width = cdf[cell + 1] - cdf[cell];
  u = width > 0 ? std::clamp((u - cdf[cell]) / width, 0.0f, one_minus_epsilon) : 0.5f;
  return cell;
}

}  // namespace

EnvironmentLight::EnvironmentLight(scene::ImagePointer image, const Mat4d& to_world, float scale)
    : image_(std::move(image)),
      scale_(scale),
      columns_(image_->width),
      rows_(std::max(image_->height - 1, 1)) {
  const glm::dmat3 linear(to_world);
  to_world_ = Mat3f(linear);
  to_local_ = Mat3f(glm::inverse(linear));
  // A cell spans four texels' centres; its weight is the mean of their luminance (bilinear interpolation is
  // positive exactly where one of the four is) plus a tenth of the image's mean, so that a cell's density is
  // never far below the radiance inside it.
  const auto texel_luminance = [&](int32_t x, int32_t y) {
    return luminance(image_->texel(((x % columns_) + columns_) % columns_, std::min(y, image_->height - 1)));
  };
  std::vector<double> cell(static_cast<size_t>(columns_) * static_cast<size_t>(rows_));
  double weighted = 0;
  double sine_sum = 0;
  for (int32_t y = 0; y < rows_; ++y) {
    const double sine = std::sin((y + 0.5) * pi / rows_);
    for (int32_t x = 0; x < columns_; ++x) {
      const double value = 0.25 * (texel_luminance(x, y) + texel_luminance(x + 1, y) +
                                   texel_luminance(x, y + 1) + texel_luminance(x + 1, y + 1));
      cell[static_cast<size_t>(y) * static_cast<size_t>(columns_) + static_cast<size_t>(x)] = value;
      weighted += value * sine;
      sine_sum += sine;
    }
  }
  const double mean_luminance = weighted / sine_sum;
  fluence_ = static_cast<float>(4.0 * pi * mean_luminance * scale_);
  row_cdf_.assign(static_cast<size_t>(rows_) + 1, 0);
  column_cdf_.assign(static_cast<size_t>(rows_) * (static_cast<size_t>(columns_) + 1), 0);
  std::vector<double> row_sum(static_cast<size_t>(rows_));
  double total = 0;
  for (int32_t y = 0; y < rows_; ++y) {
    const double sine = std::sin((y + 0.5) * pi / rows_);
    float* cdf = column_cdf_.data() + static_cast<size_t>(y) * (static_cast<size_t>(columns_) + 1);
    double sum = 0;
    std::vector<double> running(static_cast<size_t>(columns_));
    for (int32_t x = 0; x < columns_; ++x) {
      sum += cell[static_cast<size_t>(y) * static_cast<size_t>(columns_) + static_cast<size_t>(x)] +
             0.1 * mean_luminance + 1e-30;
      running[static_cast<size_t>(x)] = sum;
    }
    for (int32_t x = 0; x < columns_; ++x)
      cdf[x + 1] = static_cast<float>(running[static_cast<size_t>(x)] / sum);
    cdf[columns_] = 1;
    total += sum * sine;
    row_sum[static_cast<size_t>(y)] = total;
  }
  for (int32_t y = 0; y < rows_; ++y)
    row_cdf_[static_cast<size_t>(y) + 1] = static_cast<float>(row_sum[static_cast<size_t>(y)] / total);
  row_cdf_[static_cast<size_t>(rows_)] = 1;
}

Spectrum EnvironmentLight::evaluate(float u, float v) const {
  const float x = u * static_cast<float>(columns_) - 0.5f;
  const float y = std::clamp(v, 0.0f, 1.0f) * static_cast<float>(image_->height - 1);
  const auto x0 = static_cast<int32_t>(std::floor(x));
  const auto y0 = std::min(static_cast<int32_t>(y), std::max(image_->height - 2, 0));
  const float fx = x - static_cast<float>(x0);
  const float fy = y - static_cast<float>(y0);
  const auto texel = [&](int32_t column, int32_t row) {
    return image_->texel(((column % columns_) + columns_) % columns_, std::min(row, image_->height - 1));
  };
  return scale_ * ((texel(x0, y0) * (1 - fx) + texel(x0 + 1, y0) * fx) * (1 - fy) +
                   (texel(x0, y0 + 1) * (1 - fx) + texel(x0 + 1, y0 + 1) * fx) * fy);
}

float EnvironmentLight::pdf_uv(float u, float v) const {
  float shifted = u - 0.5f / static_cast<float>(columns_);
  shifted -= std::floor(shifted);
  const int32_t x = std::clamp(static_cast<int32_t>(shifted * static_cast<float>(columns_)), 0, columns_ - 1);
  const int32_t y = std::clamp(static_cast<int32_t>(v * static_cast<float>(rows_)), 0, rows_ - 1);
  const float* cdf = column_cdf_.data() + static_cast<size_t>(y) * (static_cast<size_t>(columns_) + 1);
  return (row_cdf_[static_cast<size_t>(y) + 1] - row_cdf_[static_cast<size_t>(y)]) *
         static_cast<float>(rows_) * (cdf[x + 1] - cdf[x]) * static_cast<float>(columns_);
}

std::optional<LightSample> EnvironmentLight::sample(const Vec3f&, const Vec2f& sample) const {
  Vec2f u = sample;
  const int32_t y = find_cell(row_cdf_.data(), rows_, u.y);
  const float* cdf = column_cdf_.data() + static_cast<size_t>(y) * (static_cast<size_t>(columns_) + 1);
  const int32_t x = find_cell(cdf, columns_, u.x);
  float image_u = (static_cast<float>(x) + u.x + 0.5f) / static_cast<float>(columns_);
  image_u -= std::floor(image_u);
  const float image_v = (static_cast<float>(y) + u.y) / static_cast<float>(rows_);
  const float theta = image_v * pi;
  const float phi = image_u * 2 * pi;
  const float sine = std::sin(theta);
  if (!(sine > 0)) return std::nullopt;
  const Vec3f local(std::sin(phi) * sine, std::cos(theta), -std::cos(phi) * sine);
  const float density = (row_cdf_[static_cast<size_t>(y) + 1] - row_cdf_[static_cast<size_t>(y)]) *
                        static_cast<float>(rows_) * (cdf[x + 1] - cdf[x]) * static_cast<float>(columns_);
  const float pdf = density / (2 * pi * pi * sine);
  if (!std::isfinite(pdf) || !(pdf > 0)) return std::nullopt;
  return LightSample{glm::normalize(to_world_ * local), infinity, evaluate(image_u, image_v), pdf};
}

float EnvironmentLight::pdf(const Vec3f&, const Vec3f& direction, const scene::SurfaceInteraction*) const {
  const Vec3f local = glm::normalize(to_local_ * direction);
  float u = std::atan2(local.x, -local.z) * (0.5f * inv_pi);
  u -= std::floor(u);
  // Near the poles 1 - y^2 and acos(y) have no digits left; the horizontal part has all of them.
  const float sine = std::sqrt(sqr(local.x) + sqr(local.z));
  const float v = std::atan2(sine, local.y) * inv_pi;
  return sine > 0 ? pdf_uv(u, v) / (2 * pi * pi * sine) : 0;
}

Spectrum EnvironmentLight::emitted(const Vec3f& direction, const scene::SurfaceInteraction*) const {
  const Vec3f local = glm::normalize(to_local_ * direction);
  float u = std::atan2(local.x, -local.z) * (0.5f * inv_pi);
  u -= std::floor(u);
  return evaluate(u, std::atan2(std::sqrt(sqr(local.x) + sqr(local.z)), local.y) * inv_pi);
}

}  // namespace fogbank::transport
