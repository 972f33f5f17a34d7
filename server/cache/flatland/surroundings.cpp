#include "cache/flatland/surroundings.h"

#include <algorithm>

namespace fogbank::cache::flatland {

using derivatives::flatland::Ring;
using derivatives::flatland::Scene;
using derivatives::flatland::Segment;
using derivatives::flatland::Sight;

namespace {

constexpr double infinity = std::numeric_limits<double>::infinity();

/// The same angle in [-pi, pi].
double wrapped(double angle) { return std::remainder(angle, 2 * std::numbers::pi); }

/// The angle under which a light is seen if nothing hides it.
class Cone {
 public:
  Cone(const Segment& light, const Vec2d& x) {
    const Vec2d start = light.start - x;
    const Vec2d end = light.end - x;
    const double first = std::atan2(start.y, start.x);
    const double turn = wrapped(std::atan2(end.y, end.x) - first);
    middle_ = first + turn / 2;
    half_ = std::fabs(turn) / 2;
    left_length_ = glm::length(turn > 0 ? end : start);
    right_length_ = glm::length(turn > 0 ? start : end);
  }

  double middle() const { return middle_; }
  /// Signed angle from the middle, counter-clockwise.
  double offset(const Sight& sight) const { return wrapped(sight.angle - middle_); }
  double half() const { return half_; }
  /// Distance of the end on the side of a signed angle.
  double end_distance(double side) const { return side > 0 ? left_length_ : right_length_; }

 private:
  double middle_ = 0;
  double half_ = 0;
  double left_length_ = 0;
  double right_length_ = 0;
};

/// Distance of the point to the line through two points at distances l and L that are gamma apart.
double distance_to_line(double l, double large_l, double gamma) {
  const double cosine = std::cos(gamma);
  if (l * cosine >= large_l) return infinity;
  const double sine = gamma < std::numbers::pi / 2 ? std::sin(gamma) : 1;
  return l * large_l * sine / std::sqrt(l * l + large_l * large_l - 2 * l * large_l * cosine);
}

/// Distance to the part of the light's line that lies beyond its ends.
double distance_beyond_ends(const Segment& light, const Vec2d& x) {
  const Vec2d along = glm::normalize(light.end - light.start);
  const double place = glm::dot(x - light.start, along);
  if (place > 0 && place < glm::distance(light.start, light.end))
    return std::min(glm::distance(x, light.start), glm::distance(x, light.end));
  return std::fabs(glm::dot(x - light.start, Vec2d(-along.y, along.x)));
}

class LightMargin {
 public:
  LightMargin(const Scene& scene, const Ring& ring, const Vec2d& x, int light)
      : scene_(scene),
        ring_(ring),
        light_(light),
        segment_(scene.segments()[static_cast<size_t>(light)]),
        cone_(segment_, x),
        x_(x) {}

  double margin() {
    look_into_cone();
    if (seen_ && blockers_ != 0) return distance_beyond_ends(segment_, x_);
    double result = seen_ ? distance_beyond_ends(segment_, x_) : infinity;
    for (size_t i = 0; i < ring_.sights.size(); ++i) {
      const Sight& sight = ring_.sights[i];
      const double offset = cone_.offset(sight);
      const double gap = std::fabs(offset) - cone_.half();
      if (gap <= 0) continue;
      const Sight& inner = offset > 0 ? ring_.before(i) : ring_.after(i);
      const double distance = seen_ ? (blocks(sight) ? sight.hit.distance : infinity)
                                    : (!blocks(sight) && blocks(inner) ? inner.hit.distance : infinity);
      if (distance == infinity) continue;
      const double gamma = std::max(0.0, gap - std::fabs(wrapped(sight.angle - inner.angle)));
      result = std::min(result, distance_to_line(distance, cone_.end_distance(offset), gamma));
    }
    return result;
  }

 private:
  void look(const Sight& sight) {
    if (sight.hit.surface == light_) {
      seen_ = true;
    } else if (scene_.is_segment(sight.hit.surface)) {
      blockers_ |= uint32_t{1} << static_cast<uint32_t>(sight.hit.surface);
    }
  }

  void look_into_cone() {
    bool any = false;
    for (const Sight& sight : ring_.sights) {
      if (std::fabs(cone_.offset(sight)) > cone_.half()) continue;
      any = true;
      look(sight);
    }
    if (any) return;
    const Vec2d direction(std::cos(cone_.middle()), std::sin(cone_.middle()));
    look({cone_.middle(), direction, scene_.trace(x_, direction), false});
  }

  /// Whether a ray ends at something that hides the light, or might if the light is seen as a whole.
  bool blocks(const Sight& sight) const {
    const int surface = sight.hit.surface;
    if (!scene_.is_segment(surface) || surface == light_) return false;
    return seen_ || (blockers_ >> static_cast<uint32_t>(surface) & 1) != 0;
  }

  const Scene& scene_;
  const Ring& ring_;
  int light_;
  const Segment& segment_;
  Cone cone_;
  Vec2d x_;
  bool seen_ = false;
  uint32_t blockers_ = 0;  ///< segments inside the cone, a bit each
};

}  // namespace

DepthBins::DepthBins(const Ring& ring) : DepthBins() {
  for (size_t i = 0; i < ring.sights.size(); ++i) {
    const Sight& from = ring.sights[i];
    const Sight& to = ring.after(i);
    // What lies between two rays is taken for as near as the nearer of them.
    const double distance = std::min(from.hit.distance, to.hit.distance);
    const size_t last = bin(to.angle);
    for (size_t b = bin(from.angle);; b = (b + 1) % count) {
      distances_[b] = std::min(distances_[b], distance);
      if (b == last) break;
    }
  }
}

double visibility_margin(const Scene& scene, const Ring& ring, const Vec2d& x) {
  static_assert(derivatives::flatland::largest_segment_count <= 32, "blockers are a bit each");
  double result = infinity;
  for (size_t i = 0; i < scene.segments().size(); ++i)
    if (scene.segments()[i].radiance > 0)
      result = std::min(result, LightMargin(scene, ring, x, static_cast<int>(i)).margin());
  return result;
}

}  // namespace fogbank::cache::flatland
