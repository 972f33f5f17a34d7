#include "cache/record_makers/ratio_margin.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <optional>

#include "core/frame.h"
#include "scene/scene.h"

namespace fogbank::cache {

namespace {

/// Rays around the light's cone: rings of sectors, denser close to it.
constexpr size_t rings = 8;
constexpr size_t sectors = 16;
/// Width of the rings in all, radians; of a wide light as wide as the light.
constexpr double least_width = 0.5;
/// Rays a side of the octahedral map, two for each depth bin: the surroundings at large.
constexpr size_t sphere_side = 16;
constexpr int bisections = 6;
/// Directions around a light, in each of which the point of its border is kept.
constexpr size_t border_sectors = 32;

struct GuardRay {
  Vec3f direction{0};
  double distance = 0;   ///< to the first surface; infinity where there is none
  double angle = 0;      ///< to the nearest point of the light
  double light = 0;      ///< distance of that point
  size_t nearest = 0;    ///< its number
  bool blocked = false;  ///< by something nearer than the light's plane across the line of sight
};

class Surroundings {
 public:
  Surroundings(const transport::World& world, const Vec3f& x, std::span<const Vec3d> light, DepthBins& depth,
               RayCounters& counters)
      : world_(world), x_(x), depth_(depth), counters_(counters) {
    Vec3d sum(0);
    for (const Vec3d& point : light)
      if (const double length = glm::length(point); length > 0) sum += point / length;
    const double length = glm::length(sum);
    axis_ = length > 0 ? sum / length : Vec3d(0, 0, 1);
    // Of a convex light the point nearest to a ray that passes it by is on its border.
    const Frame frame = Frame::from_normal(Vec3f(axis_));
    std::array<std::optional<Vec3d>, border_sectors> border;
    std::array<double, border_sectors> cosines;
    cosines.fill(2);
    for (const Vec3d& point : light) {
      if (point == Vec3d(0)) continue;
      const Vec3d local(frame.to_local(Vec3f(point)));
      const double turn = std::atan2(local.y, local.x) / (2 * static_cast<double>(pi)) + 0.5;
      const size_t sector = std::min(static_cast<size_t>(turn * border_sectors), border_sectors - 1);
      const double cosine = glm::dot(glm::normalize(point), axis_);
      if (cosine >= cosines[sector]) continue;
      cosines[sector] = cosine;
      border[sector] = point;
    }
    double cosine = 1;
    for (size_t sector = 0; sector < border_sectors; ++sector) {
      if (!border[sector]) continue;
      cosine = std::min(cosine, cosines[sector]);
      distances_.push_back(glm::length(*border[sector]));
      directions_.push_back(*border[sector] / distances_.back());
    }
    half_angle_ = std::acos(std::clamp(cosine, -1.0, 1.0));
  }

  std::vector<GuardRay> trace(std::span<const Vec3f> directions) {
    std::vector<scene::Hit> hits(directions.size());
    constexpr std::array<float, 1> limit{infinity};
    counters_.closest_hit += directions.size();
    world_.scene().intersector->intersect_solid(scene::RayBundle{x_, directions, limit}, hits);
    std::vector<GuardRay> rays(directions.size());
    for (size_t i = 0; i < rays.size(); ++i) {
      GuardRay& ray = rays[i];
      ray.direction = directions[i];
      ray.distance = hits[i].distance;
      if (std::isfinite(hits[i].distance)) depth_.insert(directions[i], hits[i].distance);
      const Vec3d direction(directions[i]);
      double cosine = -2;
      for (size_t k = 0; k < directions_.size(); ++k) {
        const double c = glm::dot(direction, directions_[k]);
        if (c <= cosine) continue;
        cosine = c;
        ray.light = distances_[k];
        ray.nearest = k;
      }
      ray.angle = std::acos(std::clamp(cosine, -1.0, 1.0));
      ray.blocked = ray.distance * cosine < ray.light * (1 - 1e-4) && cosine > 0;
    }
    return rays;
  }

  std::vector<Vec3f> around_light() const {
    const Frame frame = Frame::from_normal(Vec3f(axis_));
    std::vector<Vec3f> result;
    for (size_t ring = 0; ring < rings; ++ring) {
      const double share = static_cast<double>(ring + 1) / rings;
      const double angle = std::min(half_angle_ + width() * share * share, 3.1);
      for (size_t sector = 0; sector < sectors; ++sector) {
        const double turn = 2 * static_cast<double>(pi) *
                            (static_cast<double>(sector) + 0.5 * static_cast<double>(ring % 2)) / sectors;
        result.push_back(glm::normalize(frame.to_world(Vec3f(
            Vec3d(std::sin(angle) * std::cos(turn), std::sin(angle) * std::sin(turn), std::cos(angle))))));
      }
    }
    return result;
  }

  double width() const { return std::max(least_width, half_angle_); }
  /// Within the rings?
  bool around_light(const GuardRay& ray) const {
    return glm::dot(Vec3d(ray.direction), axis_) > std::cos(std::min(half_angle_ + width(), 3.1));
  }

  /// The point of the light's border next to `ray`.
  Vec3f nearest_of_light(const GuardRay& ray) const { return Vec3f(directions_[ray.nearest]); }

  /// What is left of each pair, one end blocked and the other not, after bisecting the directions between.
  void bisect(std::vector<std::array<GuardRay, 2>>& pairs) {
    std::vector<Vec3f> middles(pairs.size());
    for (int step = 0; step < bisections && !pairs.empty(); ++step) {
      for (size_t i = 0; i < pairs.size(); ++i)
        middles[i] = glm::normalize(pairs[i][0].direction + pairs[i][1].direction);
      const std::vector<GuardRay> found = trace(middles);
      for (size_t i = 0; i < pairs.size(); ++i)
        pairs[i][found[i].blocked == pairs[i][0].blocked ? 0 : 1] = found[i];
    }
  }

 private:
  const transport::World& world_;
  Vec3f x_;
  DepthBins& depth_;
  RayCounters& counters_;
  std::vector<Vec3d> directions_;
  std::vector<double> distances_;
  Vec3d axis_{0};
  double half_angle_ = 0;
};

/// Distance from x to the line through a point at `distance` and the nearest point of the light, `angle`
/// apart (ratio-records.md section 2, correction 1).
double distance_to_line(double distance, double light, double angle) {
  const double squared = distance * distance + light * light - 2 * distance * light * std::cos(angle);
  const double sine = angle > 0.5 * static_cast<double>(pi) ? 1.0 : std::sin(angle);
  return squared > 0 ? distance * light * sine / std::sqrt(squared) : 0.0;
}

std::vector<Vec3f> around_sphere() {
  std::vector<Vec3f> result;
  for (size_t row = 0; row < sphere_side; ++row) {
    for (size_t column = 0; column < sphere_side; ++column) {
      const float u = (2 * static_cast<float>(column) + 1) / sphere_side - 1;
      const float v = (2 * static_cast<float>(row) + 1) / sphere_side - 1;
      Vec3f direction(u, v, 1 - std::fabs(u) - std::fabs(v));
      if (direction.z < 0)
        direction = {std::copysign(1 - std::fabs(v), u), std::copysign(1 - std::fabs(u), v), direction.z};
      result.push_back(glm::normalize(direction));
    }
  }
  return result;
}

}  // namespace

float visibility_margin(const transport::World& world, const Vec3f& x, std::span<const Vec3d> light,
                        Sight sight, DepthBins& depth, RayCounters& counters) {
  Surroundings surroundings(world, x, light, depth, counters);
  const std::vector<GuardRay> sphere = surroundings.trace(around_sphere());
  if (sight == Sight::penumbra || light.empty()) return infinity;
  const std::vector<GuardRay> cone = surroundings.trace(surroundings.around_light());
  std::vector<Vec3f> of_light(sectors);
  for (size_t sector = 0; sector < sectors; ++sector)
    of_light[sector] = surroundings.nearest_of_light(cone[sector]);
  const std::vector<GuardRay> innermost = surroundings.trace(of_light);

  // Outlines are between neighbours of which one is blocked.
  std::vector<std::array<GuardRay, 2>> pairs;
  const auto pair_up = [&](const GuardRay& a, const GuardRay& b) {
    if (a.blocked != b.blocked) pairs.push_back({a, b});
  };
  for (size_t ring = 0; ring < rings; ++ring) {
    for (size_t sector = 0; sector < sectors; ++sector) {
      const GuardRay& ray = cone[ring * sectors + sector];
      pair_up(ring == 0 ? innermost[sector] : cone[(ring - 1) * sectors + sector], ray);
      pair_up(ray, cone[ring * sectors + (sector + 1) % sectors]);
    }
  }
  const auto pair_up_around = [&](const GuardRay& a, const GuardRay& b) {
    if (!surroundings.around_light(a) || !surroundings.around_light(b)) pair_up(a, b);
  };
  for (size_t row = 0; row < sphere_side; ++row) {
    for (size_t column = 0; column < sphere_side; ++column) {
      const size_t at = row * sphere_side + column;
      if (column + 1 < sphere_side) pair_up_around(sphere[at], sphere[at + 1]);
      if (row + 1 < sphere_side) pair_up_around(sphere[at], sphere[at + sphere_side]);
    }
  }
  surroundings.bisect(pairs);

  // What blocks ends at the distance at which the last blocked ray met it.
  double margin = std::numeric_limits<double>::infinity();
  for (const auto& pair : pairs) {
    const GuardRay& blocked = pair[pair[0].blocked ? 0 : 1];
    const GuardRay& clear = pair[pair[0].blocked ? 1 : 0];
    const GuardRay& towards_light = sight == Sight::lit ? blocked : clear;
    margin = std::min(margin, distance_to_line(blocked.distance, towards_light.light, towards_light.angle));
  }
  if (sight == Sight::lit) {
    for (const std::vector<GuardRay>* rays : {&cone, &sphere})
      for (const GuardRay& ray : *rays)
        if (ray.blocked) margin = std::min(margin, distance_to_line(ray.distance, ray.light, ray.angle));
  }
  return static_cast<float>(margin);
}

}  // namespace fogbank::cache
