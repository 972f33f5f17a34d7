// Lights all around: a constant one and an image.
#pragma once

#include <vector>

#include "scene/texture_library.h"
#include "transport/light.h"

namespace fogbank::transport {

/// The same radiance from everywhere.
class ConstantLight final : public Light {
 public:
  explicit ConstantLight(const Spectrum& radiance) : radiance_(radiance) {}
  std::optional<LightSample> sample(const Vec3f& x, const Vec2f& u) const override;
  float pdf(const Vec3f&, const Vec3f&, const scene::SurfaceInteraction*) const override { return inv_4pi; }
  Spectrum emitted(const Vec3f&, const scene::SurfaceInteraction*) const override { return radiance_; }
  float fluence(const Vec3f&) const override { return 4 * pi * luminance(radiance_); }
  LightShape shape() const override { return ConstantShape{radiance_}; }
  bool at_infinity() const override { return true; }
  Vec3f direction_from(const Vec3f&) const override { return Vec3f(0); }

 private:
  Spectrum radiance_;
};

/// Latitude-longitude image, bilinear between texels, sampled in proportion to its luminance. The mapping is
/// that of Mitsuba 3's `envmap`: local +y is up, u = atan2(x, -z) / 2 pi, v = acos(y) / pi.
class EnvironmentLight final : public Light {
 public:
  /// `to_world`: rotation (a scale in it cancels out of directions). `scale` multiplies the image.
  EnvironmentLight(scene::ImagePointer image, const Mat4d& to_world, float scale);
  std::optional<LightSample> sample(const Vec3f& x, const Vec2f& u) const override;
  float pdf(const Vec3f& x, const Vec3f& direction, const scene::SurfaceInteraction* hit) const override;
  Spectrum emitted(const Vec3f& direction, const scene::SurfaceInteraction* hit) const override;
  float fluence(const Vec3f&) const override { return fluence_; }
  LightShape shape() const override { return ImageShape{columns_, rows_, to_world_}; }
  bool at_infinity() const override { return true; }
  Vec3f direction_from(const Vec3f&) const override { return Vec3f(0); }

 private:
  Spectrum evaluate(float u, float v) const;
  float pdf_uv(float u, float v) const;

  scene::ImagePointer image_;
  Mat3f to_world_;
  Mat3f to_local_;
  float scale_;
  int32_t columns_;  ///< cells of the sampling grid
  int32_t rows_;
  std::vector<float> row_cdf_;     ///< rows_ + 1
  std::vector<float> column_cdf_;  ///< rows_ * (columns_ + 1)
  float fluence_ = 0;
};

}  // namespace fogbank::transport
