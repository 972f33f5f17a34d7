#include "render/film_camera.h"

#include <array>
#include <cmath>

#include "core/sobol.h"

namespace fogbank::render {

Ray FilmCamera::sample(uint32_t x, uint32_t y, RandomStream& random) const {
  // The samples of a pixel are spread over its filter.
  const std::array<uint32_t, 4> scrambles = random.next_shared();
  const Vec2f offset = scene::sample_filter_offset(
      film_,
      {scrambled_sobol(random.sample(), 0, scrambles[0]), scrambled_sobol(random.sample(), 1, scrambles[1])});
  const Vec2f position = Vec2f(static_cast<float>(x) + 0.5f, static_cast<float>(y) + 0.5f) + offset;
  return sensor_.sample_ray(film_, position, random.next_vec2());
}

float FilmCamera::pixel_angle() const {
  if (sensor_.kind == scene::SensorKind::orthographic) return 0;
  return static_cast<float>(std::atan(2 * sensor_.half_width(film_) / film_.width));
}

}  // namespace fogbank::render
