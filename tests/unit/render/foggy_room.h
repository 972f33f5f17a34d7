// A scene in which everything that a cache holds matters, in a few pixels.
#pragma once

#include <string>

namespace fogbank::render {

/// A plate in a room full of fog, and a small lamp.
inline std::string foggy_room(const std::string& sigma_t, const std::string& albedo) {
  return R"(<medium type="homogeneous" id="fog"><rgb name="sigma_t" value=")" + sigma_t +
         R"("/><rgb name="albedo" value=")" + albedo + R"("/></medium>
  <sensor type="perspective">
    <float name="fov" value="60"/>
    <transform name="to_world"><lookat origin="0, -1.8, 0" target="0, 0, 0" up="0, 0, 1"/></transform>
    <ref name="medium" id="fog"/>
  </sensor>
  <bsdf type="twosided" id="wall"><bsdf type="diffuse"><rgb name="reflectance" value="0.5, 0.4, 0.3"/></bsdf></bsdf>
  <shape type="cube"><transform name="to_world"><scale x="2" y="2" z="1"/></transform><ref id="wall"/></shape>
  <shape type="rectangle">
    <transform name="to_world"><rotate x="1" angle="180"/><scale value="0.4"/><translate x="0" y="0" z="0.99"/></transform>
    <bsdf type="diffuse"><rgb name="reflectance" value="0"/></bsdf>
    <emitter type="area"><rgb name="radiance" value="10, 9, 7"/></emitter>
  </shape>
  <shape type="rectangle"><transform name="to_world"><scale value="0.5"/></transform><ref id="wall"/></shape>)";
}

}  // namespace fogbank::render
