#include "render/picture_plan.h"

#include "integrators/medium_records.h"
#include "integrators/single_scattering_plan.h"
#include "render/film_camera.h"
#include "render/progression.h"

namespace fogbank::render {

std::vector<integrators::Decision> picture_plan(const transport::World& world,
                                                const RenderSettings& settings) {
  validate(settings);
  const FilmCamera camera(settings.sensor, settings.film);
  std::vector<integrators::Decision> decisions = integrators::medium_decisions(world, {});
  const auto lights =
      integrators::single_scattering_plan(world, integrator_settings(settings), camera, {}).decisions;
  decisions.insert(decisions.end(), lights.begin(), lights.end());
  return decisions;
}

}  // namespace fogbank::render
