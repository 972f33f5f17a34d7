// What may stand between a light and a point: decided from the geometry alone, before any ray is traced, and
// only where it is certain.
#pragma once

#include <vector>

#include "core/vector.h"
#include "transport/world.h"

namespace fogbank::transport {

/// Which surfaces count as standing in the way.
enum class ObstacleKind : uint8_t {
  occluders,  ///< all that stop some light: everything but BSDFs of type null
  passing     ///< all that light goes through (`Shape::passes_light`), where transmittance changes medium
};

/// Obstacles of one light. A surface can't come between a flat light and a point when it lies behind the
/// light, and a flat surface can't when the light and the point are on the same side of its plane; so a light
/// in a convex room is free from everywhere inside. Round surfaces, instances, and scenes of more than
/// `most_triangles` count as obstacles everywhere.
class LightObstacles {
 public:
  static constexpr size_t most_triangles = 512;

  /// May anything be between `x` and some point of the light? False is a promise.
  bool possible(const Vec3f& x) const {
    if (anywhere_) return true;
    for (const HalfSpace& half : free_where_)
      if (!(glm::dot(half.normal, Vec3d(x)) + half.offset > 0)) return true;
    return false;
  }
  /// Possible at every point as far as is known.
  bool anywhere() const { return anywhere_; }
  /// Possible nowhere.
  bool nowhere() const { return !anywhere_ && free_where_.empty(); }

  /// One for each light of the world, in the order of `World::lights()`.
  static std::vector<LightObstacles> of_all(const World& world, ObstacleKind kind);

 private:
  friend class ObstacleFinder;

  struct HalfSpace {
    Vec3d normal{0, 0, 1};
    double offset = 0;
  };

  bool anywhere_ = true;
  std::vector<HalfSpace> free_where_;  ///< nothing is in between for x within all of these
};

}  // namespace fogbank::transport
