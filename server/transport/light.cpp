#include "transport/light.h"

namespace fogbank::transport {

void Light::fluence_along(const Vec3f& origin, const Vec3f& direction, const float* t, int count,
                          float* values) const {
  for (int i = 0; i < count; ++i) values[i] = fluence(origin + direction * t[i]);
}

Vec3f Light::direction_from(const Vec3f& x) const {
  const Vec3f towards = bounds_.center - x;
  const float length = glm::length(towards);
  return length > 0 ? towards / length : Vec3f(0);
}

}  // namespace fogbank::transport
