// The two-dimensional model: segments in a box filled with a homogeneous medium.
#pragma once

#include <vector>

#include "core/vector.h"

namespace fogbank::derivatives::flatland {

/// Largest coordinate, extinction and radiance, and the reciprocal of the smallest side of the box: far
/// inside of what double takes to the second derivative.
inline constexpr double largest_number = 1e12;
/// Points closer than this share of the box's diagonal to a surface have no derivatives (method.md section
/// 4.5).
inline constexpr double smallest_clearance = 1e-9;

/// Light of the medium from optically deeper than this does not count: exp(-50) = 2e-22 of it arrives.
inline constexpr double greatest_depth = 50;

/// Most segments of a scene: visibility costs up to the fourth power of their number.
inline constexpr int32_t largest_segment_count = 32;

/// A black surface that emits the same radiance from both sides in all directions.
struct Segment {
  Vec2d start{0};
  Vec2d end{0};
  double radiance = 0;  ///< W/(m rad), up to the scene's scale; 0: only occludes
};

/// All that makes a scene.
struct SceneDescription {
  Vec2d box_min{0};
  Vec2d box_max{1};  ///< the box's four sides are black walls
  double sigma_t = 1;
  double albedo = 1;
  std::vector<Segment> segments;
};

/// Where a ray ends.
struct Hit {
  double distance = 0;
  int surface = 0;  ///< segment, or `segments().size()` + side of the box
};

/// All points with normal . p = offset; `normal` has unit length.
struct Line {
  Vec2d normal{0};
  double offset = 0;
};

/// Line through two different points.
Line line_through(const Vec2d& a, const Vec2d& b);

/// A checked scene with what its rays need. Immutable.
class Scene {
 public:
  /// Throws Error(invalid_argument, "INVALID_SCENE") naming the field.
  explicit Scene(SceneDescription description);

  const std::vector<Segment>& segments() const { return description_.segments; }
  double sigma_t() const { return description_.sigma_t; }
  double sigma_s() const { return description_.sigma_t * description_.albedo; }
  /// Of the box; the unit of relative tolerances.
  double diagonal() const { return diagonal_; }
  /// Length beyond which nothing of the medium's light arrives.
  double reach() const {
    return sigma_t() * diagonal_ > greatest_depth ? greatest_depth / sigma_t() : diagonal_;
  }
  const Vec2d& box_min() const { return description_.box_min; }
  const Vec2d& box_max() const { return description_.box_max; }

  bool is_segment(int surface) const { return surface < static_cast<int>(segments().size()); }
  /// Emitted radiance of a surface.
  double radiance(int surface) const {
    return is_segment(surface) ? segments()[static_cast<size_t>(surface)].radiance : 0;
  }
  /// The line that a surface lies on.
  const Line& line(int surface) const { return lines_[static_cast<size_t>(surface)]; }

  /// Where visibility may change: the segments' ends and crossings.
  const std::vector<Vec2d>& vertices() const { return vertices_; }

  /// First surface in a direction of unit length; there always is one.
  Hit trace(const Vec2d& x, const Vec2d& direction) const;
  /// Distance to a segment along a direction; infinite if there is none.
  double distance(int segment, const Vec2d& x, const Vec2d& direction) const;

  /// Throws Error(invalid_argument, "INVALID_POINT"): outside of the box, or on a surface.
  void check_point(const Vec2d& x) const;

 private:
  SceneDescription description_;
  double diagonal_ = 0;
  std::vector<Line> lines_;  ///< of the segments, then of the box's sides: right, left, top, bottom
  std::vector<Vec2d> vertices_;
};

}  // namespace fogbank::derivatives::flatland
