// Lights on the exact round shapes.
#pragma once

#include "transport/lights/area_light.h"

namespace fogbank::transport {

/// Sphere that emits outwards, or inwards when `inwards`. From outside sampled uniformly by solid angle over
/// its visible cap.
class SphereLight final : public AreaLight {
 public:
  SphereLight(const Vec3f& center, float radius, bool inwards, const Mat4d& to_local,
              scene::TexturePointer radiance);
  std::optional<LightSample> sample(const Vec3f& x, const Vec2f& u) const override;
  float pdf(const Vec3f& x, const Vec3f& direction, const scene::SurfaceInteraction* hit) const override;
  float fluence(const Vec3f& x) const override;
  LightShape shape() const override {
    return SphereShape{bounds_.center, bounds_.radius, inwards_, to_local_, radiance_.get()};
  }

 private:
  Vec2f uv_of(const Vec3f& normal) const;

  bool inwards_;
  Mat3f to_local_;  ///< rotation part only
};

/// Elliptical disk: the unit disk under an affine map; emits towards its normal. Sampled by area.
class DiskLight final : public AreaLight {
 public:
  DiskLight(const Vec3f& center, const Vec3f& axis_x, const Vec3f& axis_y, bool flipped,
            scene::TexturePointer radiance);
  std::optional<LightSample> sample(const Vec3f& x, const Vec2f& u) const override;
  float pdf(const Vec3f& x, const Vec3f& direction, const scene::SurfaceInteraction* hit) const override;
  float fluence(const Vec3f& x) const override;
  LightShape shape() const override {
    return DiskShape{bounds_.center, axis_x_, axis_y_, bounds_.axis, radiance_.get()};
  }

 private:
  Vec3f axis_x_;
  Vec3f axis_y_;
  float area_;
};

/// Open cylinder that emits outwards (inwards when `inwards`). From outside sampled over its visible half
/// only.
class CylinderLight final : public AreaLight {
 public:
  /// `base` and `top` are the ends of the axis; `axis_x` the direction of u = 0, of length `radius`.
  CylinderLight(const Vec3f& base, const Vec3f& top, const Vec3f& axis_x, bool inwards, bool mirrored,
                scene::TexturePointer radiance);
  std::optional<LightSample> sample(const Vec3f& x, const Vec2f& u) const override;
  float pdf(const Vec3f& x, const Vec3f& direction, const scene::SurfaceInteraction* hit) const override;
  float fluence(const Vec3f& x) const override;
  LightShape shape() const override {
    return CylinderShape{base_, axis_, axis_x_, axis_y_, length_, radius_, inwards_, radiance_.get()};
  }

 private:
  /// Half the angle of the emitting part that can face `x`, and its middle; 0 when none can.
  float visible_half_angle(const Vec3f& x, float& middle) const;

  Vec3f base_;
  Vec3f axis_;    ///< unit
  Vec3f axis_x_;  ///< unit
  Vec3f axis_y_;  ///< unit
  float length_;
  float radius_;
  bool inwards_;
};

}  // namespace fogbank::transport
