// What all area lights share: a radiance texture and one-sided emission.
#pragma once

#include "scene/texture.h"
#include "transport/light.h"

namespace fogbank::transport {

/// One-sided diffuse emitter. `radiance`: W/m^2/sr, leaving on the side that the surface's normal points to.
class AreaLight : public Light {
 public:
  explicit AreaLight(scene::TexturePointer radiance)
      : radiance_(std::move(radiance)), mean_luminance_(luminance(radiance_->mean())) {}

  Spectrum emitted(const Vec3f& direction, const scene::SurfaceInteraction* hit) const final {
    if (!(glm::dot(direction, hit->geometric_normal) < 0)) return Spectrum(0);
    return radiance_->evaluate(hit->uv);
  }

 protected:
  /// A sample at point `y` with normal `n` (unit) drawn with density `pdf_area` per area.
  std::optional<LightSample> sample_of_point(const Vec3f& x, const Vec3f& y, const Vec3f& n, const Vec2f& uv,
                                             float pdf_area) const;
  /// Density per solid angle of area sampling, for a hit.
  static float pdf_of_hit(const Vec3f& direction, const scene::SurfaceInteraction& hit, float pdf_area);

  scene::TexturePointer radiance_;
  float mean_luminance_;
};

/// Solid angles below this are sampled by area: there distance and cosine vary by some 20 % over the light,
/// which adds a few per cent of variance to what visibility makes anyway, and the spherical forms cost
/// several inverse cosines and lose digits (they are differences of numbers near pi).
inline constexpr float least_spherical_solid_angle = 0.05f;

}  // namespace fogbank::transport
