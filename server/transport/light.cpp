#include "transport/light.h"

namespace fogbank::transport {

Vec3f Light::direction_from(const Vec3f& x) const {
  const Vec3f towards = bounds_.center - x;
  const float length = glm::length(towards);
  return length > 0 ? towards / length : Vec3f(0);
}

}  // namespace fogbank::transport
