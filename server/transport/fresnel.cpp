#include "transport/fresnel.h"

namespace fogbank::transport {

float fresnel_conductor(float cos_theta_i, float eta, float k) {
  const float cos_squared = sqr(cos_theta_i);
  const float sin_squared = std::fmax(0.0f, 1.0f - cos_squared);
  const float difference = eta * eta - k * k - sin_squared;
  const float a_squared_plus_b_squared = std::sqrt(sqr(difference) + 4.0f * sqr(eta * k));
  const float a = safe_sqrt(0.5f * (a_squared_plus_b_squared + difference));
  const float two_a_cos = 2.0f * a * cos_theta_i;
  const float sum = a_squared_plus_b_squared + cos_squared;
  const float perpendicular_denominator = sum + two_a_cos;
  if (!(perpendicular_denominator > 0.0f)) return 1.0f;
  // Rounding leaves -1e-8 or so where nothing is reflected (eta = 1, k = 0).
  const float perpendicular = std::fmax(0.0f, (sum - two_a_cos) / perpendicular_denominator);
  const float parallel_sum = cos_squared * a_squared_plus_b_squared + sqr(sin_squared);
  const float parallel_difference = two_a_cos * sin_squared;
  const float parallel_denominator = parallel_sum + parallel_difference;
  // Both vanish for eta = k = 0 at normal incidence, where the two polarisations are the same.
  const float ratio = parallel_denominator > 0.0f
                          ? std::fmax(0.0f, (parallel_sum - parallel_difference) / parallel_denominator)
                          : 1.0f;
  return 0.5f * perpendicular * (1.0f + ratio);
}

float fresnel_diffuse_reflectance(float eta) {
  const float inverse = 1.0f / eta;
  // What gets in is what gets out (reciprocity), so the reflectance from inside follows from that outside.
  if (eta < 0.4f) return 1.0f - (1.0f - fresnel_diffuse_reflectance(inverse)) * eta * eta;
  if (eta < 1.0f) return ((-1.4399f * eta) + 0.7099f) * eta + 0.6681f + 0.0636f * inverse;
  const float coefficients[] = {-1.36881f, 4.98554f, -7.80989f, 6.75335f, -3.4793f, 0.919317f};
  float sum = 0;
  for (const float coefficient : coefficients) sum = sum * inverse + coefficient;
  return sum;
}

}  // namespace fogbank::transport
