// Microfacet distributions with separable Smith masking and visible-normal sampling.
#pragma once

#include "core/vector.h"

namespace fogbank::transport {

/// Inverse of the error function to float precision (Giles 2012, "Approximating the erfinv function",
/// single-precision table). `x` in (-1, 1).
float inverse_erf(float x);

enum class MicrofacetType : uint8_t { beckmann, ggx };

/// Distribution of the normals of a rough surface (Walter et al. 2007, "Microfacet Models for Refraction
/// through Rough Surfaces", section 5.2; anisotropic as in Heitz 2014, "Understanding the Masking-Shadowing
/// Function"). Directions and normals are unit vectors in the local shading frame, alpha_u along its tangent.
/// Cheap to construct: one per evaluation, because roughness may be textured.
class MicrofacetDistribution {
 public:
  /// Smallest roughness; below it floats no longer resolve the lobe.
  static constexpr float least_alpha = 1e-4f;

  MicrofacetDistribution(MicrofacetType type, float alpha_u, float alpha_v)
      : type_(type), alpha_u_(std::fmax(alpha_u, least_alpha)), alpha_v_(std::fmax(alpha_v, least_alpha)) {}

  /// Density of normals D(m), 1/sr: the integral of D(m) m.z over the hemisphere is 1.
  float density(const Vec3f& m) const;

  /// Smith's masking G1(v, m) in [0, 1]. For Beckmann the rational fit of Walter et al. 2007 (below eq. 27,
  /// relative error < 0.35 %): what Mitsuba evaluates, so that rough materials look the same there and here.
  float masking(const Vec3f& v, const Vec3f& m) const;
  /// G1(v, m) / |v.z|, finite at grazing incidence too.
  float masking_over_cosine(const Vec3f& v, const Vec3f& m) const;

  /// Normal as seen from `v` (v.z > 0) with density `visible_normal_pdf`.
  /// GGX: Dupuy and Benyoub 2023, "Sampling Visible GGX Normals with Spherical Caps". Beckmann: inversion of
  /// the marginal of Heitz and d'Eon 2014, "Importance Sampling Microfacet-Based BSDFs using the Distribution
  /// of Visible Normals", in the variable erf(slope).
  Vec3f sample_visible_normal(const Vec3f& v, const Vec2f& u) const;
  /// D(m) G1(v, m) dot(v, m) / v.z, 1/sr, with the exact G1 for both types: the fit would leave this density
  /// off by its error, and sampling with it.
  float visible_normal_pdf(const Vec3f& v, const Vec3f& m) const;

 private:
  /// Length of v's projection stretched by the roughness; |v.z| over it is the cotangent that G1 is made of.
  float stretched_sine(const Vec3f& v) const { return std::sqrt(sqr(alpha_u_ * v.x) + sqr(alpha_v_ * v.y)); }
  /// Normal's slope towards a viewer at cos_theta (> 0) in the stretched space of roughness 1 (x: towards
  /// it).
  static Vec2f sample_beckmann_slope(float cos_theta, const Vec2f& u);

  MicrofacetType type_;
  float alpha_u_;
  float alpha_v_;
};

}  // namespace fogbank::transport
