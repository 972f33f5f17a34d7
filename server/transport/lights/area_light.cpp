#include "transport/lights/area_light.h"

namespace fogbank::transport {

std::optional<LightSample> AreaLight::sample_of_point(const Vec3f& x, const Vec3f& y, const Vec3f& n,
                                                      const Vec2f& uv, float pdf_area) const {
  const Vec3f towards = y - x;
  const float distance_squared = glm::dot(towards, towards);
  if (!(distance_squared > 0)) return std::nullopt;
  const float distance = std::sqrt(distance_squared);
  const Vec3f direction = towards / distance;
  const float cosine = -glm::dot(direction, n);
  if (!(cosine > 0)) return std::nullopt;
  const float pdf = pdf_area * distance_squared / cosine;
  if (!std::isfinite(pdf) || !(pdf > 0)) return std::nullopt;
  return LightSample{direction, distance, radiance_->evaluate(uv), pdf};
}

float AreaLight::pdf_of_hit(const Vec3f& direction, const scene::SurfaceInteraction& hit, float pdf_area) {
  const float cosine = -glm::dot(direction, hit.geometric_normal);
  return cosine > 0 ? pdf_area * sqr(hit.distance) / cosine : 0;
}

}  // namespace fogbank::transport
