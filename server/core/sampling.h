// Warps from the unit square and their densities.
#pragma once

#include "core/vector.h"

namespace fogbank {

/// Unit disk, area-preserving and low in distortion (Shirley and Chiu 1997, "A Low Distortion Map Between
/// Disk and Square").
inline Vec2f square_to_disk_concentric(const Vec2f& u) {
  const float a = 2.0f * u.x - 1.0f;
  const float b = 2.0f * u.y - 1.0f;
  if (a == 0.0f && b == 0.0f) return {0.0f, 0.0f};
  float radius = 0;
  float angle = 0;
  if (std::fabs(a) > std::fabs(b)) {
    radius = a;
    angle = (pi / 4) * (b / a);
  } else {
    radius = b;
    angle = (pi / 2) - (pi / 4) * (a / b);
  }
  return {radius * std::cos(angle), radius * std::sin(angle)};
}

/// Cosine-weighted direction of the upper hemisphere; density cos(theta) / pi.
inline Vec3f square_to_cosine_hemisphere(const Vec2f& u) {
  const Vec2f p = square_to_disk_concentric(u);
  return {p.x, p.y, safe_sqrt(1.0f - p.x * p.x - p.y * p.y)};
}

/// Uniform direction; density 1 / (4 pi).
inline Vec3f square_to_uniform_sphere(const Vec2f& u) {
  const float z = 1.0f - 2.0f * u.x;
  const float r = safe_sqrt(1.0f - z * z);
  const float phi = 2.0f * pi * u.y;
  return {r * std::cos(phi), r * std::sin(phi), z};
}

/// Uniform direction within `cos_max` of +z; density 1 / (2 pi (1 - cos_max)).
inline Vec3f square_to_uniform_cone(const Vec2f& u, float one_minus_cos_max) {
  // 1 - cos is kept as the variable: cones of the sun's size lose all digits in cos itself.
  const float one_minus_cos = u.x * one_minus_cos_max;
  const float z = 1.0f - one_minus_cos;
  const float r = safe_sqrt(one_minus_cos * (2.0f - one_minus_cos));
  const float phi = 2.0f * pi * u.y;
  return {r * std::cos(phi), r * std::sin(phi), z};
}

/// Uniform barycentric coordinates (b1, b2) of a triangle (Heitz 2019, "A Low-Distortion Map Between Triangle
/// and Square").
inline Vec2f square_to_uniform_triangle(const Vec2f& u) {
  if (u.y > u.x) {
    const float x = u.x * 0.5f;
    return {x, u.y - x};
  }
  const float y = u.y * 0.5f;
  return {u.x - y, y};
}

}  // namespace fogbank
