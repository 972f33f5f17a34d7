// Extent of a scene.
#pragma once

#include "scene/scene.h"

namespace fogbank::scene {

/// Sphere around the box of all surfaces, instances included; radius 0 for an empty scene.
BoundingSphere surface_bounds(const Scene& scene);

}  // namespace fogbank::scene
