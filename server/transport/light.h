// Light sources as the sampler sees them: one `Light` per rectangle, triangle, sphere, disk, cylinder, point,
// spot, directional source, constant or image-based environment. One file per kind in lights/.
#pragma once

#include <cstdint>
#include <memory>
#include <optional>

#include "core/vector.h"
#include "scene/intersector.h"
#include "transport/light_shape.h"

namespace fogbank::transport {

/// Light arriving at a point from one sampled direction, nothing in between.
struct LightSample {
  Vec3f direction{0, 0, 1};   ///< unit, towards the light
  float distance = infinity;  ///< infinity for lights at infinity
  Spectrum radiance{0};       ///< W/m^2/sr; for delta lights irradiance on a surface facing it, W/m^2
  float pdf = 0;              ///< per solid angle; 1 for delta lights
};

/// Bounding sphere and cone of a light at a finite place; what light trees and distance sampling need to know
/// of it.
struct LightBounds {
  Vec3f center{0};
  float radius = 0;       ///< 0 for points
  Vec3f axis{0, 0, 1};    ///< mean emission direction
  float cos_spread = -1;  ///< all emitting normals lie within acos(cos_spread) of `axis`; -1: all directions
  float cos_emission =
      0;  ///< light leaves within acos(cos_emission) of a normal: 0 for area lights, -1 for points
  float intensity =
      0;  ///< luminance of radiance times area (area lights) or of the peak intensity (points), W/sr
};

/// Immutable; safe from any thread.
class Light {
 public:
  virtual ~Light() = default;

  /// Draws a direction towards the light, by solid angle where a closed form is known. nullopt where no light
  /// can arrive.
  virtual std::optional<LightSample> sample(const Vec3f& x, const Vec2f& u) const = 0;
  /// Density of `sample` at `x` for the direction that met the light at `hit` (null for lights at infinity).
  virtual float pdf(const Vec3f& x, const Vec3f& direction, const scene::SurfaceInteraction* hit) const = 0;
  /// Radiance that a ray in `direction` meets at the light: leaving `hit` against it, or from infinity.
  virtual Spectrum emitted(const Vec3f& direction, const scene::SurfaceInteraction* hit) const = 0;
  /// Luminance of the unoccluded fluence at `x` (radiance times solid angle), without transmittance: the
  /// proxy Mhat * 4 pi of ratio-records.md section 1, exact or approximate. 0 only where no light can arrive.
  virtual float fluence(const Vec3f& x) const = 0;

  /// `fluence` at `count` points origin + t direction: what tables along rays are made of, in one call so
  /// that the loop over points can run in vector registers.
  virtual void fluence_along(const Vec3f& origin, const Vec3f& direction, const float* t, int count,
                             float* values) const;

  /// Geometry and radiance. Pointers in it live as long as the light.
  virtual LightShape shape() const = 0;

  virtual bool is_delta() const { return false; }
  virtual bool at_infinity() const { return false; }
  /// Meaningful for lights at a finite place only.
  const LightBounds& bounds() const { return bounds_; }
  /// Direction towards the light for phase functions: to its centre, or for infinite lights their mean
  /// direction (zero length when they have none).
  virtual Vec3f direction_from(const Vec3f& x) const;

 protected:
  LightBounds bounds_;
};
using LightPointer = std::unique_ptr<const Light>;

}  // namespace fogbank::transport
