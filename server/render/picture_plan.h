// What an integrator would settle for a picture, without making it.
#pragma once

#include <vector>

#include "integrators/integrator.h"
#include "render/render_settings.h"
#include "transport/world.h"

namespace fogbank::render {

/// What media of anisotropic phase functions would get, and how each light's single scattering would get into
/// the picture, with no record there yet. Throws as `validate` does.
std::vector<integrators::Decision> picture_plan(const transport::World& world,
                                                const RenderSettings& settings);

}  // namespace fogbank::render
