// Worlds from scene text, with fog all around.
#pragma once

#include <memory>
#include <string>

#include "transport/world_builders.h"

namespace fogbank::derivatives::test {

/// `body`: shapes and emitters. The sensor stands in unbounded fog.
inline std::shared_ptr<const transport::World> world_in_fog(const std::string& sigma_t,
                                                            const std::string& albedo,
                                                            const std::string& body) {
  return transport::test::parse_world(
      R"(<medium type="homogeneous" id="fog"><rgb name="sigma_t" value=")" + sigma_t +
      R"("/><rgb name="albedo" value=")" + albedo +
      R"("/></medium><sensor type="perspective"><ref name="medium" id="fog"/></sensor>)" + body);
}

/// Emits downwards from z = 2: |x| <= 1, |y| <= 1. Reflects nothing.
inline const std::string ceiling_light = R"(<shape type="rectangle">
    <transform name="to_world"><rotate x="1" angle="180"/><translate z="2"/></transform>
    <bsdf type="diffuse"><rgb name="reflectance" value="0"/></bsdf>
    <emitter type="area"><rgb name="radiance" value="1, 2, 3"/></emitter></shape>)";

/// Around that light and the origin; reflects nothing.
inline const std::string black_room = R"(<shape type="cube">
    <transform name="to_world"><scale x="4" y="4" z="2.5"/></transform>
    <bsdf type="twosided"><bsdf type="diffuse"><rgb name="reflectance" value="0"/></bsdf></bsdf></shape>)";

}  // namespace fogbank::derivatives::test
