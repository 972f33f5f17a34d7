// The closed forms that `principled` is made of.
#pragma once

#include "core/vector.h"

namespace fogbank::transport {

/// (1 - cosine)^5 (Schlick 1994).
inline float schlick_weight(float cosine) {
  const float m = glm::clamp(1.0f - cosine, 0.0f, 1.0f);
  return sqr(sqr(m)) * m;
}

/// `schlick_weight` of the larger of the angles on both sides of an interface with relative index `eta`.
/// `cosine`: of the arriving direction, negative from inside.
inline float schlick_weight_refracted(float cosine, float eta) {
  const float eta_it = cosine >= 0.0f ? eta : 1.0f / eta;
  if (eta_it > 1.0f) return schlick_weight(std::fabs(cosine));
  return schlick_weight(safe_sqrt(1.0f - (1.0f - cosine * cosine) / sqr(eta_it)));
}

/// Schlick's Fresnel reflectance for one at normal incidence.
template <typename Reflectance>
Reflectance schlick(const Reflectance& normal_reflectance, float weight) {
  return normal_reflectance + (Reflectance(1) - normal_reflectance) * weight;
}

/// Hue and saturation of a colour at luminance 1; white for black.
inline Spectrum tint_of(const Spectrum& color) {
  const float value = luminance(color);
  return value > 0.0f ? color / value : Spectrum(1);
}

/// Reflectance of the diffuse lobe relative to Lambert's: Burley 2012, section 5.3, split into diffuse and
/// retro-reflection as in Burley 2015, eq. 4, and blended with the flattened lobe by `flatness`.
inline float diffuse_shape(float cos_o, float cos_i, float cos_d, float roughness, float flatness) {
  const float weight_o = schlick_weight(cos_o);
  const float weight_i = schlick_weight(cos_i);
  const float retro = 2.0f * roughness * cos_d * cos_d;
  const float plain = (1.0f - 0.5f * weight_o) * (1.0f - 0.5f * weight_i) +
                      retro * (weight_o + weight_i + weight_o * weight_i * (retro - 1.0f));
  if (!(flatness > 0.0f)) return plain;
  const float edge = 0.5f * retro;
  const float both = (1.0f + (edge - 1.0f) * weight_o) * (1.0f + (edge - 1.0f) * weight_i);
  const float flat = 1.25f * (both * (1.0f / (cos_o + cos_i) - 0.5f) + 0.5f);
  return plain + (flat - plain) * flatness;
}

/// Second specular lobe: GTR1, with longer tails than GGX (Burley 2012, appendix B.2), and a fixed masking.
class ClearcoatLobe {
 public:
  explicit ClearcoatLobe(float gloss) : alpha_squared_(sqr(0.1f + (0.001f - 0.1f) * gloss)) {}

  /// Density of normals, 1/sr.
  float density(const Vec3f& m) const {
    // 1 + (alpha^2 - 1) cos^2 without the cancellation at the peak.
    const float sine_squared = m.x * m.x + m.y * m.y;
    const float denominator = sine_squared + alpha_squared_ * m.z * m.z;
    return (alpha_squared_ - 1.0f) / (pi * std::log(alpha_squared_) * denominator);
  }

  /// Normal with density D(m) m.z.
  Vec3f sample(const Vec2f& u) const {
    const float sine_squared =
        (std::pow(alpha_squared_, 1.0f - u.y) - alpha_squared_) / (1.0f - alpha_squared_);
    const float sine = safe_sqrt(sine_squared);
    const float azimuth = 2.0f * pi * u.x;
    return {sine * std::cos(azimuth), sine * std::sin(azimuth), safe_sqrt(1.0f - sine_squared)};
  }

  /// Smith's GGX masking for alpha = 0.25.
  static float masking(const Vec3f& v) {
    const float z_squared = v.z * v.z;
    return 2.0f * std::fabs(v.z) /
           (std::fabs(v.z) + std::sqrt(z_squared + 0.0625f * std::fmax(0.0f, 1.0f - z_squared)));
  }

 private:
  float alpha_squared_;
};

}  // namespace fogbank::transport
