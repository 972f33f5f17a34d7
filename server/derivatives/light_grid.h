// A light as seen from a point, cut into triangles whose vertices lie on it (method.md section 7).
#pragma once

#include <array>
#include <cstdint>
#include <memory>
#include <optional>
#include <vector>

#include "core/random.h"
#include "core/vector.h"
#include "transport/plan.h"
#include "transport/world.h"

namespace fogbank::derivatives {

/// Triangles counter-clockwise as seen from x when nothing is inverted by jitter: their form factors are
/// signed and are to be added as they are (method.md section 2).
struct LightGrid {
  struct Triangle {
    std::array<uint32_t, 3> vertices{};
    Spectrum radiance{0};  ///< mean over the triangle of what it emits towards x
  };

  /// A piece of the outline of a round light. The points of tangency roll over the light as x moves, which
  /// fixed vertices miss: the solid angle's Hessian gains `bend` t t^T, t = `outward` (method.md section 6.4
  /// c, per arc length).
  struct RoundEdge {
    std::array<uint32_t, 2> vertices{};
    Spectrum radiance{0};
    Vec3d outward{0};  ///< unit, across the line of sight, away from the light
    double bend = 0;   ///< arc length (rad) times rho / l^3, 1/length^2
  };

  /// Sphere or cylinder that edges of the grid are chords of.
  struct RoundSurface {
    Vec3d center{0};  ///< relative to x; any point of the axis for cylinders
    Vec3d axis{0};    ///< unit; zero for spheres
    double radius = 0;
    bool inwards = false;

    /// The point in a unit direction: the nearer one from outside; where the line misses, the point of the
    /// line that is closest to the axis or centre.
    Vec3d in_direction(const Vec3d& direction) const;
  };

  /// A triangle that counts as unoccluded, with nothing but the medium around x before it.
  struct Unoccluded {
    std::array<Vec3d, 3> vertices{};
    Spectrum radiance{0};  ///< may be negative: a correction
  };

  std::vector<Vec3d> vertices;  ///< relative to x; unit directions where `at_infinity`
  std::vector<Triangle> triangles;
  std::vector<RoundEdge> round_edges;
  std::vector<Unoccluded> unoccluded;
  std::optional<RoundSurface> round;
  bool at_infinity = false;

  void clear();
  /// The point of the light between two neighbouring vertices, at `share` of the way.
  Vec3d between(const Vec3d& a, const Vec3d& b, double share) const;
  /// The point of the light in the middle of a triangle.
  Vec3d middle(const Vec3d& a, const Vec3d& b, const Vec3d& c) const;

 private:
  Vec3d on_light(const Vec3d& point) const;
};

/// One emitter of the scene. Immutable; safe from any thread.
class GriddedLight {
 public:
  virtual ~GriddedLight() = default;
  /// The part that can send light to `x` (world space), in triangles; empty if there is none. Draws only from
  /// `random`, for jitter.
  virtual void cut(const Vec3d& x, RandomStream& random, LightGrid& grid) const = 0;
};

struct PlannedLight {
  std::vector<uint32_t> lights;  ///< of the world: several for a mesh
  std::unique_ptr<const GriddedLight> gridded;
};

/// All emitters that the plan gives a grid, the triangles of a mesh as one, cut into some 2 n^2 triangles
/// each (8 n^2 where they surround x); n >= 2. Points closer to a light than `least_distance` count as that
/// far away, where derivatives are infinite.
std::vector<PlannedLight> planned_lights(const transport::World& world, const transport::Plan& plan,
                                         int32_t n, double least_distance);

}  // namespace fogbank::derivatives
