#include "transport/microfacet.h"

#include <algorithm>

namespace fogbank::transport {

namespace {

constexpr float inv_sqrt_pi = 0.56418958354775628695f;

bool same_side(const Vec3f& v, const Vec3f& m) { return glm::dot(v, m) * v.z > 0.0f; }

}  // namespace

float inverse_erf(float x) {
  float w = -std::log((1.0f - x) * (1.0f + x));
  float p = 0;
  if (w < 5.0f) {
    w -= 2.5f;
    const float coefficients[] = {2.81022636e-08f,  3.43273939e-07f, -3.5233877e-06f,
                                  -4.39150654e-06f, 0.00021858087f,  -0.00125372503f,
                                  -0.00417768164f,  0.246640727f,    1.50140941f};
    for (const float coefficient : coefficients) p = p * w + coefficient;
  } else {
    w = std::sqrt(w) - 3.0f;
    const float coefficients[] = {-0.000200214257f, 0.000100950558f, 0.00134934322f,
                                  -0.00367342844f,  0.00573950773f,  -0.0076224613f,
                                  0.00943887047f,   1.00167406f,     2.83297682f};
    for (const float coefficient : coefficients) p = p * w + coefficient;
  }
  return p * x;
}

float MicrofacetDistribution::density(const Vec3f& m) const {
  if (!(m.z > 0.0f)) return 0.0f;
  const float stretched = sqr(m.x / alpha_u_) + sqr(m.y / alpha_v_);
  const float z_squared = m.z * m.z;
  float result = 0;
  if (type_ == MicrofacetType::beckmann) {
    // exp(-80) is below what a float density of any allowed roughness can feel, and stopping here keeps the
    // division by z^4 in range.
    if (!(stretched < 80.0f * z_squared)) return 0.0f;
    result = std::exp(-stretched / z_squared) / (pi * alpha_u_ * alpha_v_ * sqr(z_squared));
  } else {
    result = 1.0f / (pi * alpha_u_ * alpha_v_ * sqr(stretched + z_squared));
  }
  return result * m.z > 1e-20f ? result : 0.0f;
}

float MicrofacetDistribution::masking(const Vec3f& v, const Vec3f& m) const {
  return std::fmin(1.0f, masking_over_cosine(v, m) * std::fabs(v.z));
}

float MicrofacetDistribution::masking_over_cosine(const Vec3f& v, const Vec3f& m) const {
  if (!same_side(v, m)) return 0.0f;  // a facet's back can't be seen from its front
  const float z = std::fabs(v.z);
  const float s = stretched_sine(v);
  if (type_ == MicrofacetType::ggx) return 2.0f / (z + std::sqrt(z * z + s * s));
  if (z >= 1.6f * s) return 1.0f / z;
  const float a = z / s;
  return (3.535f + 2.181f * a) / (s * (1.0f + (2.276f + 2.577f * a) * a));
}

float MicrofacetDistribution::visible_normal_pdf(const Vec3f& v, const Vec3f& m) const {
  const float cosine = glm::dot(v, m);
  if (!(cosine > 0.0f && v.z > 0.0f)) return 0.0f;
  const float s = stretched_sine(v);
  float masking = 0;  // over v.z
  if (type_ == MicrofacetType::ggx) {
    masking = 2.0f / (v.z + std::sqrt(v.z * v.z + s * s));
  } else if (v.z >= 4.0f * s) {
    masking = 1.0f / v.z;  // exact to float precision: erfc(4) = 1.5e-8
  } else {
    const float a = v.z / s;
    masking = 2.0f / (v.z * (1.0f + std::erf(a)) + s * inv_sqrt_pi * std::exp(-a * a));
  }
  return density(m) * masking * cosine;
}

Vec3f MicrofacetDistribution::sample_visible_normal(const Vec3f& v, const Vec2f& u) const {
  const Vec3f stretched = glm::normalize(Vec3f(alpha_u_ * v.x, alpha_v_ * v.y, v.z));
  if (type_ == MicrofacetType::ggx) {
    const float azimuth = 2.0f * pi * u.x;
    // Height of the half vector, formed without the cancellation of the cap's own height.
    const float height = (1.0f - u.y) * (1.0f + stretched.z);
    const float z = height - stretched.z;
    const float r = safe_sqrt(1.0f - z * z);
    return glm::normalize(Vec3f(alpha_u_ * (r * std::cos(azimuth) + stretched.x),
                                alpha_v_ * (r * std::sin(azimuth) + stretched.y), height));
  }
  const Vec2f slope = sample_beckmann_slope(stretched.z, u);
  const float projected = std::sqrt(sqr(stretched.x) + sqr(stretched.y));
  const float cos_azimuth = projected > 0.0f ? stretched.x / projected : 1.0f;
  const float sin_azimuth = projected > 0.0f ? stretched.y / projected : 0.0f;
  return glm::normalize(Vec3f(alpha_u_ * (cos_azimuth * slope.x - sin_azimuth * slope.y),
                              alpha_v_ * (sin_azimuth * slope.x + cos_azimuth * slope.y), 1.0f));
}

Vec2f MicrofacetDistribution::sample_beckmann_slope(float cos_theta, const Vec2f& u) {
  // Slopes of a Beckmann surface are Gaussian; those seen from theta are weighted by cos + x sin, x being the
  // slope towards the viewer, and vanish for x < -cot. With t = erf(-x), t in [-1, erf(cot)], the CDF is
  //   F(t) ~ 1 + t + tan / sqrt(pi) exp(-x^2),   F'(t) = 1 + x tan,
  // divided by (1 + tan) here so that neither end overflows at grazing or normal incidence.
  constexpr float edge = 1e-6f;  // keeps erfinv finite: slopes end at 3.5 standard deviations
  const float sin_theta = safe_sqrt(1.0f - cos_theta * cos_theta);
  const float scale = 1.0f / (cos_theta + sin_theta);
  const float flat = cos_theta * scale;    // 1 / (1 + tan)
  const float tilted = sin_theta * scale;  // tan / (1 + tan)
  const float cotangent = sin_theta > 0.0f ? cos_theta / sin_theta : infinity;
  const float highest = cotangent < 4.0f ? std::erf(cotangent) : 1.0f;
  const float total = flat * (1.0f + highest) +
                      (cotangent < 9.0f ? tilted * inv_sqrt_pi * std::exp(-cotangent * cotangent) : 0.0f);
  const float u_x = std::clamp(u.x, edge, 1.0f - edge);
  const float target = u_x * total;

  // Halley's method, kept inside a shrinking bracket. It starts from the solution at theta = 0 or pi / 2,
  // where the CDF is 1 + t or exp(-x^2). Its error falls with the third power, so a small step is the last
  // one.
  float low = -1.0f;
  float high = highest;
  float t =
      cotangent > 1.0f ? 2.0f * u_x - 1.0f : highest - (1.0f + highest) * std::erf(std::sqrt(-std::log(u_x)));
  for (int iteration = 0; iteration < 12; ++iteration) {
    if (!(t >= low && t <= high)) t = 0.5f * (low + high);
    const float x = inverse_erf(std::clamp(t, -1.0f + 1e-7f, 1.0f - 1e-7f));
    const float gaussian = std::exp(-x * x);
    const float excess = flat * (1.0f + t) + tilted * inv_sqrt_pi * gaussian - target;
    (excess > 0.0f ? high : low) = t;
    const float slope = flat - tilted * x;
    const float curvature = -0.5f * tilted / (inv_sqrt_pi * gaussian);
    const float step = excess / (slope - 0.5f * excess * curvature / slope);
    t -= step;
    if (std::fabs(step) < 0.03f * std::fmin(1.0f + t, highest - t)) break;
  }
  if (!(t >= low && t <= high)) t = 0.5f * (low + high);
  const float y = std::clamp(2.0f * u.y - 1.0f, -1.0f + edge, 1.0f - edge);
  return {-inverse_erf(std::clamp(t, -1.0f + 1e-7f, 1.0f - 1e-7f)), inverse_erf(y)};
}

}  // namespace fogbank::transport
