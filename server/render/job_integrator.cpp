#include "render/job_integrator.h"

#include <utility>

#include "core/error.h"
#include "render/progression.h"
#include "transport/world.h"

namespace fogbank::render {

std::unique_ptr<integrators::Integrator> make_job_integrator(std::shared_ptr<const transport::World> world,
                                                             const RenderSettings& settings) {
  validate(settings);
  const auto media = static_cast<int64_t>(world->scene().media.size());
  if (settings.sensor.medium < scene::none || settings.sensor.medium >= media) {
    throw Error(ErrorKind::invalid_argument, "INVALID_RENDER_SETTINGS",
                "sensor.medium: the scene has no medium " + std::to_string(settings.sensor.medium));
  }
  return integrators::make_integrator(settings.integrator, std::move(world), integrator_settings(settings));
}

}  // namespace fogbank::render
