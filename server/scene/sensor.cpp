#include "scene/sensor.h"

#include <algorithm>
#include <array>
#include <cmath>

#include "core/sampling.h"

namespace fogbank::scene {
namespace {

constexpr double degrees_per_radian = 180 / 3.14159265358979323846;

/// Film position as a point of the camera's local plane z = 1 (perspective, thinlens) or of the plane x in
/// [-1, 1] (orthographic), where half the film's width spans `half_width`. Local x runs to the image's left,
/// as in Mitsuba: its camera looks along +z with +y up, and a right-handed frame then has +x on the left.
Vec2d film_to_plane(const Film& film, const Vec2d& principal_point_offset, const Vec2f& position,
                    double half_width) {
  const double width = film.width;
  const double height = film.height;
  // Mitsuba's offset is a share of the film's size and is added to the position.
  const double x = position.x / width + principal_point_offset.x;
  const double y = position.y / height + principal_point_offset.y;
  return {(1 - 2 * x) * half_width, (1 - 2 * y) * half_width * (height / width)};
}

Vec3d transform_point(const Mat4d& m, const Vec3d& p) { return Vec3d(m * glm::dvec4(p, 1.0)); }
Vec3d transform_vector(const Mat4d& m, const Vec3d& v) { return Vec3d(m * glm::dvec4(v, 0.0)); }

Ray make_ray(const Vec3d& origin, const Vec3d& direction, double max_distance) {
  return {Vec3f(origin), Vec3f(glm::normalize(direction)), static_cast<float>(max_distance)};
}

/// Inverse of the cumulative distribution of exp(-x^2 / 2) - exp(-8), cut at |x| = 4: Mitsuba's gaussian
/// filter (which falls to 0 at its radius) in units of its standard deviation. The density is tabulated as a
/// step function; a step is 1/256 standard deviation wide, so the filter's second moment is off by less than
/// 2e-6.
class GaussianFilterTable {
 public:
  GaussianFilterTable() {
    const double floor = std::exp(-8.0);
    double sum = 0;
    for (size_t i = 0; i < steps; ++i) {
      cumulative_[i] = sum;
      const double x = -4 + (static_cast<double>(i) + 0.5) * step_width;
      sum += std::exp(-0.5 * x * x) - floor;
    }
    cumulative_[steps] = sum;
    for (double& value : cumulative_) value /= sum;
  }

  float sample(float u) const {
    const auto above = std::upper_bound(cumulative_.begin(), cumulative_.end(), static_cast<double>(u));
    const auto i = std::min<size_t>(static_cast<size_t>(above - cumulative_.begin()) - 1, steps - 1);
    const double within = (u - cumulative_[i]) / (cumulative_[i + 1] - cumulative_[i]);
    return static_cast<float>(-4 + (static_cast<double>(i) + within) * step_width);
  }

 private:
  static constexpr size_t steps = 2048;
  static constexpr double step_width = 8.0 / steps;
  std::array<double, steps + 1> cumulative_{};
};

float sample_tent(float u) { return u < 0.5f ? std::sqrt(2 * u) - 1 : 1 - std::sqrt(2 * (1 - u)); }

}  // namespace

double Sensor::half_width(const Film& film) const {
  const double aspect = static_cast<double>(film.width) / film.height;
  const double half_tangent = std::tan(0.5 * fov_degrees / degrees_per_radian);
  switch (fov_axis) {
    case FovAxis::x:
      break;
    case FovAxis::y:
      return half_tangent * aspect;
    case FovAxis::smaller:
      return aspect > 1 ? half_tangent * aspect : half_tangent;
    case FovAxis::larger:
      return aspect > 1 ? half_tangent : half_tangent * aspect;
    case FovAxis::diagonal:
      return half_tangent / std::sqrt(1 + 1 / (aspect * aspect));
  }
  return half_tangent;
}

double Sensor::fov_x_degrees(const Film& film) const {
  return 2 * std::atan(half_width(film)) * degrees_per_radian;
}

Ray Sensor::sample_ray(const Film& film, const Vec2f& position, const Vec2f& lens) const {
  if (kind == SensorKind::orthographic) {
    const Vec2d plane = film_to_plane(film, principal_point_offset, position, 1.0);
    const Vec3d origin = transform_point(to_world, Vec3d(plane, near_clip));
    return make_ray(origin, transform_vector(to_world, {0, 0, 1}), far_clip - near_clip);
  }
  const Vec2d plane = film_to_plane(film, principal_point_offset, position, half_width(film));
  Vec3d origin(0);
  Vec3d through(plane, 1.0);
  if (kind == SensorKind::thinlens) {
    origin = Vec3d(aperture_radius * Vec2d(square_to_disk_concentric(lens)), 0.0);
    through = through * focus_distance - origin;
  }
  const Vec3d direction = glm::normalize(through);
  // The clip planes are planes of constant local z.
  const double near_distance = near_clip / direction.z;
  const double far_distance = far_clip / direction.z;
  const Vec3d world_direction = glm::normalize(transform_vector(to_world, direction));
  return make_ray(transform_point(to_world, origin) + near_distance * world_direction, world_direction,
                  far_distance - near_distance);
}

Vec2f sample_filter_offset(const Film& film, const Vec2f& u) {
  switch (film.filter) {
    case ReconstructionFilter::box:
      return (2.0f * u - 1.0f) * film.filter_radius;
    case ReconstructionFilter::tent:
      return Vec2f(sample_tent(u.x), sample_tent(u.y)) * film.filter_radius;
    case ReconstructionFilter::gaussian:
      break;
  }
  static const GaussianFilterTable table;
  return Vec2f(table.sample(u.x), table.sample(u.y)) * film.filter_stddev;
}

}  // namespace fogbank::scene
