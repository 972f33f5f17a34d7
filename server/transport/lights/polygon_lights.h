// Flat lights with straight edges, sampled uniformly by solid angle.
#pragma once

#include <array>

#include "core/frame.h"
#include "transport/lights/area_light.h"

namespace fogbank::transport {

/// Triangle. Vertices counter-clockwise seen from the emitting side.
class TriangleLight final : public AreaLight {
 public:
  TriangleLight(const std::array<Vec3f, 3>& vertices, const std::array<Vec2f, 3>& uvs,
                scene::TexturePointer radiance);
  std::optional<LightSample> sample(const Vec3f& x, const Vec2f& u) const override;
  float pdf(const Vec3f& x, const Vec3f& direction, const scene::SurfaceInteraction* hit) const override;
  float fluence(const Vec3f& x) const override;
  LightShape shape() const override { return TriangleShape{vertices_, uvs_, radiance_.get()}; }

 private:
  float solid_angle(const Vec3f& x) const;

  std::array<Vec3f, 3> vertices_;
  std::array<Vec2f, 3> uvs_;
  Vec3f normal_;
  float area_;
};

/// Rectangle (right angles), from `corner` along `edge_x` and `edge_y`; emits towards edge_x x edge_y.
class RectangleLight final : public AreaLight {
 public:
  /// `uvs`: at corner, corner + edge_x, corner + edge_y.
  RectangleLight(const Vec3f& corner, const Vec3f& edge_x, const Vec3f& edge_y,
                 const std::array<Vec2f, 3>& uvs, scene::TexturePointer radiance);
  std::optional<LightSample> sample(const Vec3f& x, const Vec2f& u) const override;
  float pdf(const Vec3f& x, const Vec3f& direction, const scene::SurfaceInteraction* hit) const override;
  float fluence(const Vec3f& x) const override;
  void fluence_along(const Vec3f& origin, const Vec3f& direction, const float* t, int count,
                     float* values) const override;
  LightShape shape() const override;

 private:
  /// The rectangle in a frame at x (Urena, Fajardo and King 2013, "An Area-Preserving Parametrization for
  /// Spherical Rectangles", section 3): [x0, x1] x [y0, y1] at z0 < 0.
  struct Local {
    float x0, x1, y0, y1, z0;
    float b0, b1, k, solid_angle;
  };
  Local localise(const Vec3f& x) const;

  Vec3f corner_;
  Frame frame_;  ///< tangent and bitangent along the edges, normal on the emitting side
  float width_;
  float height_;
  std::array<Vec2f, 3> uvs_;
};

}  // namespace fogbank::transport
