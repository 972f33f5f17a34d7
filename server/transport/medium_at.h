// What `World::medium_at` prepares when a world is built.
#pragma once

#include <vector>

#include "scene/scene.h"

namespace fogbank::transport {

/// A few points on surfaces that bound media, in world space: at most one a shape, at most 8. Empty when no
/// surface bounds a medium.
std::vector<Vec3f> points_on_medium_boundaries(const scene::Scene& scene);

}  // namespace fogbank::transport
