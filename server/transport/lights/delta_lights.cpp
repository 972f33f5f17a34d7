#include "transport/lights/delta_lights.h"

namespace fogbank::transport {

PointLight::PointLight(const Vec3f& position, const Spectrum& intensity) : intensity_(intensity) {
  bounds_ = {position, 0, {0, 0, 1}, -1, -1, luminance(intensity)};
}

std::optional<LightSample> PointLight::sample(const Vec3f& x, const Vec2f&) const {
  const Vec3f towards = bounds_.center - x;
  const float distance_squared = glm::dot(towards, towards);
  if (!(distance_squared > 0)) return std::nullopt;
  const float distance = std::sqrt(distance_squared);
  return LightSample{towards / distance, distance, intensity_ / distance_squared, 1};
}

float PointLight::fluence(const Vec3f& x) const {
  const Vec3f towards = bounds_.center - x;
  return bounds_.intensity / std::fmax(glm::dot(towards, towards), std::numeric_limits<float>::min());
}

SpotLight::SpotLight(const Vec3f& position, const Vec3f& axis, const Spectrum& intensity, float cutoff_angle,
                     float beam_width)
    : intensity_(intensity),
      cutoff_angle_(cutoff_angle),
      beam_width_(beam_width),
      cos_cutoff_(std::cos(cutoff_angle)),
      cos_beam_(std::cos(beam_width)) {
  bounds_ = {position, 0, axis, 1, cos_cutoff_, luminance(intensity)};
}

float SpotLight::falloff(const Vec3f& from_light) const {
  const float cosine = glm::dot(from_light, bounds_.axis);
  if (cosine >= cos_beam_) return 1;
  if (cosine <= cos_cutoff_) return 0;
  return (cutoff_angle_ - std::acos(cosine)) / (cutoff_angle_ - beam_width_);
}

std::optional<LightSample> SpotLight::sample(const Vec3f& x, const Vec2f&) const {
  const Vec3f towards = bounds_.center - x;
  const float distance_squared = glm::dot(towards, towards);
  if (!(distance_squared > 0)) return std::nullopt;
  const float distance = std::sqrt(distance_squared);
  const Vec3f direction = towards / distance;
  const float share = falloff(-direction);
  if (!(share > 0)) return std::nullopt;
  return LightSample{direction, distance, intensity_ * (share / distance_squared), 1};
}

float SpotLight::fluence(const Vec3f& x) const {
  const Vec3f towards = bounds_.center - x;
  const float distance_squared = std::fmax(glm::dot(towards, towards), std::numeric_limits<float>::min());
  // Kept positive outside the cone: a segment whose two ends lie outside may cross it.
  return bounds_.intensity * std::fmax(falloff(-towards / std::sqrt(distance_squared)), 0.02f) /
         distance_squared;
}

DirectionalLight::DirectionalLight(const Vec3f& direction, const Spectrum& irradiance)
    : direction_(direction), irradiance_(irradiance) {}

std::optional<LightSample> DirectionalLight::sample(const Vec3f&, const Vec2f&) const {
  return LightSample{-direction_, infinity, irradiance_, 1};
}

}  // namespace fogbank::transport
