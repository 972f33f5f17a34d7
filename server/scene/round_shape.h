// Sphere, disk and cylinder, intersected in double precision.
#pragma once

#include "core/vector.h"
#include "scene/shape.h"

namespace fogbank::scene {

/// A sphere, disk or cylinder (unit shapes as described at `Shape`) under an affine map. Single precision
/// loses a far sphere's silhouette and lets rays that start on it hit it again; doubles cost little here,
/// since scenes have few such shapes.
class RoundShape {
 public:
  /// `kind` must not be `triangle_mesh`; `to_world` must be invertible.
  RoundShape(ShapeKind kind, const Mat4d& to_world);

  /// Nearest intersection with `lower` <= distance <= `upper`, in units of `direction` (of any length).
  bool intersect(const Vec3d& origin, const Vec3d& direction, float lower, float upper,
                 float& distance) const;

  /// Axis-aligned box, rounded outwards.
  void bounds(Vec3f& lower, Vec3f& upper) const;

 private:
  bool crosses_unit_shape(const Vec3d& origin, const Vec3d& direction, double distance) const;

  ShapeKind kind_;
  Mat4d to_world_;
  Mat4d from_world_;
};

/// Differential geometry of a point on a round shape, in the shape's own space.
struct RoundShapePoint {
  Vec3d position{0};
  Vec3d normal{0, 0, 1};  ///< outwards, unit length for a unit shape
  Vec2d uv{0};
  Vec3d dp_du{1, 0, 0};
  Vec3d dp_dv{0, 1, 0};
};

/// Projects `local`, a point near the unit shape, onto it. Parametrisations are Mitsuba 3's: sphere u =
/// azimuth / 2 pi, v = polar angle / pi; disk u = radius, v = azimuth / 2 pi; cylinder u = azimuth / 2 pi, v
/// = z.
RoundShapePoint round_shape_point(ShapeKind kind, const Vec3d& local);

}  // namespace fogbank::scene
