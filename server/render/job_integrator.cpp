#include "render/job_integrator.h"

#include <utility>

#include "core/error.h"
#include "render/progression.h"
#include "scene/intersector.h"
#include "transport/world.h"

namespace fogbank::render {

int32_t camera_medium(const transport::World& world, const scene::Sensor& sensor) {
  if (sensor.to_world == world.scene().sensor.to_world) return sensor.medium;
  scene::prepare_render_thread();
  // Any film will do: rays through its middle are alike.
  const scene::Film film;
  const Vec2f middle(static_cast<float>(film.width) / 2, static_cast<float>(film.height) / 2);
  return world.medium_at(sensor.sample_ray(film, middle, {0.5f, 0.5f}).origin);
}

std::unique_ptr<integrators::Integrator> make_job_integrator(std::shared_ptr<const transport::World> world,
                                                             const RenderSettings& settings) {
  validate(settings);
  const auto media = static_cast<int64_t>(world->scene().media.size());
  if (settings.sensor.medium < scene::none || settings.sensor.medium >= media) {
    throw Error(ErrorKind::invalid_argument, "INVALID_RENDER_SETTINGS",
                "sensor.medium: the scene has no medium " + std::to_string(settings.sensor.medium));
  }
  integrators::IntegratorSettings resolved = integrator_settings(settings);
  resolved.camera_medium = camera_medium(*world, settings.sensor);
  return integrators::make_integrator(settings.integrator, std::move(world), resolved);
}

}  // namespace fogbank::render
