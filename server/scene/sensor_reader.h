// `<sensor>` elements with their film and sampler, and `<integrator>`.
#pragma once

#include <string>
#include <vector>

#include "scene/description.h"
#include "scene/scene.h"
#include "scene/scene_builder.h"

namespace fogbank::scene {

/// Sets `sensor`, `film` and the samples per pixel of the builder's scene. What Mitsuba's film and sampler
/// know beside size, crop, filter and sample count does not change the radiance that is computed and is
/// passed over, with a warning where the result could differ. Throws SceneError, also UNKNOWN_PLUGIN and
/// CROP_OUTSIDE_FILM.
void read_sensor(const ObjectDescription& description, SceneBuilder& builder);

/// Sets depths and `hide_emitters`. Integrators other than path tracing become volpath, with a warning;
/// integrators that wrap another one stand for that one.
void read_integrator(const ObjectDescription& description, RenderDefaults& defaults,
                     std::vector<std::string>& warnings);

}  // namespace fogbank::scene
