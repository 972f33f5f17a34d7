// Fresnel reflectance of smooth interfaces, and the mirror and refraction directions that go with it.
#pragma once

#include "core/vector.h"

namespace fogbank::transport {

/// What happens to light at a dielectric interface.
struct DielectricFresnel {
  float reflectance = 0;  ///< unpolarised, in [0, 1]; 1 under total internal reflection
  float cos_theta_t = 0;  ///< signed: on the other side than cos_theta_i; 0 under total internal reflection
  float eta_it = 1;       ///< index of the side the light goes to over that of the side it comes from
  float eta_ti = 1;       ///< 1 / eta_it
};

/// Fresnel equations for a dielectric (Born and Wolf 1999, section 1.5.2, eq. 21), unpolarised.
/// `cos_theta_i`: in [-1, 1], measured against the normal, negative from inside.
/// `eta`: interior over exterior index of refraction, > 0.
inline DielectricFresnel fresnel_dielectric(float cos_theta_i, float eta) {
  DielectricFresnel result;
  const bool outside = cos_theta_i >= 0;
  const float inverse_eta = 1.0f / eta;
  result.eta_it = outside ? eta : inverse_eta;
  result.eta_ti = outside ? inverse_eta : eta;
  const float cos_i = std::fabs(cos_theta_i);
  const float cos_t_squared = 1.0f - sqr(result.eta_ti) * (1.0f - cos_i * cos_i);
  const float cos_t = safe_sqrt(cos_t_squared);
  result.cos_theta_t = outside ? -cos_t : cos_t;
  if (eta == 1.0f) return result;  // index-matched: 0 / 0 at grazing incidence otherwise
  if (cos_i == 0.0f || cos_t_squared <= 0.0f) {
    result.reflectance = 1.0f;
    return result;
  }
  const float perpendicular = (cos_i - result.eta_it * cos_t) / (cos_i + result.eta_it * cos_t);
  const float parallel = (result.eta_it * cos_i - cos_t) / (result.eta_it * cos_i + cos_t);
  result.reflectance = 0.5f * (sqr(perpendicular) + sqr(parallel));
  return result;
}

/// Fresnel reflectance of a conductor with complex index eta + i k against vacuum, unpolarised (Born and Wolf
/// 1999, section 14.2). `cos_theta_i` in [0, 1]; eta, k >= 0.
float fresnel_conductor(float cos_theta_i, float eta, float k);

inline Spectrum fresnel_conductor(float cos_theta_i, const Spectrum& eta, const Spectrum& k) {
  return {fresnel_conductor(cos_theta_i, eta.x, k.x), fresnel_conductor(cos_theta_i, eta.y, k.y),
          fresnel_conductor(cos_theta_i, eta.z, k.z)};
}

/// Share of diffuse (cosine-weighted) light that a smooth dielectric interface reflects, seen from the side
/// with relative index `eta` = other side over this side. Fits: Egan and Hilgeman 1973 for eta < 1 (good to
/// 0.6 % above 0.5), d'Eon and Irving 2011 for eta >= 1 (0.2 % below 10): the pair that Mitsuba 3 uses, so
/// that `plastic` has the same albedo there and here. Below 0.4, where the former passes 1 and Mitsuba with
/// it, the latter takes over by reciprocity.
float fresnel_diffuse_reflectance(float eta);

/// Mirror image of `w` about the unit vector `m`.
inline Vec3f reflect(const Vec3f& w, const Vec3f& m) { return 2.0f * glm::dot(w, m) * m - w; }

/// Direction on the other side of an interface with unit normal `m` for light at `w`; `cos_theta_t` and
/// `eta_ti` as `fresnel_dielectric(dot(w, m), eta)` gives them.
inline Vec3f refract(const Vec3f& w, const Vec3f& m, float cos_theta_t, float eta_ti) {
  return m * (glm::dot(w, m) * eta_ti + cos_theta_t) - w * eta_ti;
}

}  // namespace fogbank::transport
