// Lights without extent: point, spot, directional. Only next-event estimation finds them.
#pragma once

#include "transport/light.h"

namespace fogbank::transport {

/// Point light. `intensity`: W/sr.
class PointLight final : public Light {
 public:
  PointLight(const Vec3f& position, const Spectrum& intensity);
  std::optional<LightSample> sample(const Vec3f& x, const Vec2f& u) const override;
  float pdf(const Vec3f&, const Vec3f&, const scene::SurfaceInteraction*) const override { return 0; }
  Spectrum emitted(const Vec3f&, const scene::SurfaceInteraction*) const override { return Spectrum(0); }
  float fluence(const Vec3f& x) const override;
  LightShape shape() const override {
    return PointShape{.position = bounds_.center, .intensity = intensity_};
  }
  bool is_delta() const override { return true; }

 private:
  Spectrum intensity_;
};

/// Spot light along `axis`: full intensity within `beam_width`, falling linearly in angle to 0 at
/// `cutoff_angle` (radians), as Mitsuba 3's `spot`.
class SpotLight final : public Light {
 public:
  SpotLight(const Vec3f& position, const Vec3f& axis, const Spectrum& intensity, float cutoff_angle,
            float beam_width);
  std::optional<LightSample> sample(const Vec3f& x, const Vec2f& u) const override;
  float pdf(const Vec3f&, const Vec3f&, const scene::SurfaceInteraction*) const override { return 0; }
  Spectrum emitted(const Vec3f&, const scene::SurfaceInteraction*) const override { return Spectrum(0); }
  float fluence(const Vec3f& x) const override;
  LightShape shape() const override {
    return PointShape{bounds_.center, intensity_, bounds_.axis, beam_width_, cutoff_angle_};
  }
  bool is_delta() const override { return true; }

 private:
  float falloff(const Vec3f& from_light) const;

  Spectrum intensity_;
  float cutoff_angle_;
  float beam_width_;
  float cos_cutoff_;
  float cos_beam_;
};

/// Parallel light travelling along `direction`. `irradiance`: W/m^2 on a plane across it.
class DirectionalLight final : public Light {
 public:
  DirectionalLight(const Vec3f& direction, const Spectrum& irradiance);
  std::optional<LightSample> sample(const Vec3f& x, const Vec2f& u) const override;
  float pdf(const Vec3f&, const Vec3f&, const scene::SurfaceInteraction*) const override { return 0; }
  Spectrum emitted(const Vec3f&, const scene::SurfaceInteraction*) const override { return Spectrum(0); }
  float fluence(const Vec3f&) const override { return luminance(irradiance_); }
  LightShape shape() const override { return DirectionalShape{direction_, irradiance_}; }
  bool is_delta() const override { return true; }
  bool at_infinity() const override { return true; }
  Vec3f direction_from(const Vec3f&) const override { return -direction_; }

 private:
  Vec3f direction_;
  Spectrum irradiance_;
};

}  // namespace fogbank::transport
