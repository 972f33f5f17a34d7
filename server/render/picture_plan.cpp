#include "render/picture_plan.h"

#include "integrators/single_scattering_plan.h"
#include "render/film_camera.h"
#include "render/progression.h"

namespace fogbank::render {

std::vector<integrators::Decision> picture_plan(const transport::World& world,
                                                const RenderSettings& settings) {
  validate(settings);
  const FilmCamera camera(settings.sensor, settings.film);
  return integrators::single_scattering_plan(world, integrator_settings(settings), camera, {}).decisions;
}

}  // namespace fogbank::render
