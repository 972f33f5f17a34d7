// The integrator that a job and its replicas render with.
#pragma once

#include <memory>

#include "integrators/integrator.h"
#include "render/render_settings.h"

namespace fogbank::transport {
class World;
}

namespace fogbank::render {

/// The medium that a job's camera rays start in: a file's camera says it itself; one that was moved is asked
/// where it is, World::medium_at the middle of its near clip plane. Leaves the thread prepared for rendering.
int32_t camera_medium(const transport::World& world, const scene::Sensor& sensor);

/// Throws like `validate` and `make_integrator`, and Error(invalid_argument, "INVALID_RENDER_SETTINGS") where
/// the scene hasn't what the settings name.
std::unique_ptr<integrators::Integrator> make_job_integrator(std::shared_ptr<const transport::World> world,
                                                             const RenderSettings& settings);

}  // namespace fogbank::render
