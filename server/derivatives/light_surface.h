// Lights as surfaces: normals, and parametrisations of the part that faces a point.
#pragma once

#include <functional>
#include <optional>

#include "core/vector.h"
#include "transport/light_shape.h"

namespace fogbank::derivatives {

/// Unit normal of a light's surface at its point y, either way; zero for lights that are no surface.
Vec3d light_normal(const transport::LightShape& shape, const Vec3d& y);

/// A point of a light.
struct LightPoint {
  Vec3d position{0};
  Vec3d normal{0, 0, 1};  ///< unit, to the emitting side
  double area = 0;        ///< per unit of du dv
  Spectrum radiance{0};   ///< W/m^2/sr
};

/// A light's surface over the unit square, as seen from one point: smooth, and covering all that can send
/// light there. Lines of constant v are cut by silhouettes; they are about `length` long and `width` apart
/// in total, scene units.
struct LightPatch {
  std::function<LightPoint(double u, double v)> at;
  double length = 0;
  double width = 0;
};

/// nullopt for lights that are no surface, and where none of it faces x.
std::optional<LightPatch> light_patch(const transport::LightShape& shape, const Vec3d& x);

}  // namespace fogbank::derivatives
