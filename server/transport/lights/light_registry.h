// Emitter elements of a scene to lights. A new kind of emitter is one function in light_registry.cpp's table.
#pragma once

#include <string>
#include <vector>

#include "scene/scene.h"
#include "transport/light.h"

namespace fogbank::transport {

/// All lights of a scene, and how to find the one a surface hit belongs to.
struct SceneLights {
  static constexpr uint32_t no_light = 0xFFFFFFFFu;

  std::vector<LightPointer> lights;
  std::vector<uint32_t> first_of_shape;  ///< per shape: index of its first light, or no_light
  std::vector<std::vector<uint32_t>>
      of_primitive;  ///< per shape: light of each primitive; empty when one light serves all

  uint32_t of_hit(uint32_t shape, uint32_t primitive) const {
    if (of_primitive[shape].empty()) return first_of_shape[shape];
    return of_primitive[shape][primitive];
  }
};

/// Throws SceneError for unknown emitters (naming the supported ones), wrong parameters, and shapes without
/// area. Lenient scenes: an unknown emitter is dropped, with a warning.
SceneLights build_lights(scene::Scene& scene);

/// Names of all emitter plugins, sorted.
std::vector<std::string> supported_emitters();

}  // namespace fogbank::transport
