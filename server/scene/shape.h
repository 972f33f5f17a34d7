// Shapes: where surfaces are, what they are made of, what lies on either side.
#pragma once

#include <cstdint>
#include <vector>

#include "core/vector.h"
#include "scene/description.h"
#include "scene/mesh.h"

namespace fogbank::scene {

/// Rectangles and cubes are triangle meshes; the round shapes are intersected exactly.
enum class ShapeKind : uint8_t { triangle_mesh, sphere, disk, cylinder };

inline constexpr int32_t none = -1;

/// One surface. Indices point into the vectors of `Scene`; `none` where there is nothing.
/// sphere: unit sphere; disk: unit disk at z = 0, normal +z; cylinder: unit radius around z from z = 0 to 1,
/// open ends; each under `to_world`, which for sphere and cylinder is a similarity (rotation, translation,
/// uniform scale; the cylinder's z may be scaled apart).
struct Shape {
  std::string id;
  ShapeKind kind = ShapeKind::triangle_mesh;
  SourceLocation where;
  int32_t mesh = none;
  Mat4d to_world{1.0};
  bool flip_normals =
      false;               ///< applied to geometric and shading normals alike; meshes keep their vertex order
  int32_t bsdf = none;     ///< always set after loading (the file's default is a diffuse one)
  int32_t emitter = none;  ///< area light on this shape
  bool is_medium_boundary = false;
  int32_t interior_medium = none;  ///< behind the surface (against the normal)
  int32_t exterior_medium = none;  ///< before it
  bool passes_light =
      false;  ///< its BSDF has a null component (null, mask, thindielectric...): shadow rays go on through it
  int32_t group = none;  ///< the shape group it belongs to; such shapes are seen through instances only
};

/// One placement of a shape group.
struct Instance {
  int32_t group = none;
  Mat4d to_world{1.0};
};

}  // namespace fogbank::scene
