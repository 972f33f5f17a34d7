// The camera of a job: rays through its film.
#pragma once

#include "integrators/integrator.h"
#include "scene/sensor.h"

namespace fogbank::render {

class FilmCamera final : public integrators::CameraRays {
 public:
  FilmCamera(const scene::Sensor& sensor, const scene::Film& film) : sensor_(sensor), film_(film) {}

  Ray sample(uint32_t x, uint32_t y, RandomStream& random) const override;
  scene::Window window() const override { return film_.crop; }
  Vec2i film_size() const override { return {film_.width, film_.height}; }
  Vec3f position() const override { return Vec3f(sensor_.to_world[3]); }
  float pixel_angle() const override;

 private:
  scene::Sensor sensor_;
  scene::Film film_;
};

}  // namespace fogbank::render
