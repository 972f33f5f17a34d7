// How far a record of the two-dimensional cache may be extrapolated (method.md section 10).
#pragma once

#include <array>

#include "cache/flatland/record.h"
#include "cache/metric.h"

namespace fogbank::cache::flatland {

enum class Metric : uint8_t {
  /// The Hessian bounds the error of linear extrapolation; its integral over the extent is the threshold.
  second_order,
  /// The occlusion-unaware rival's: radius = threshold * Record::change_length, extrapolation of the
  /// logarithm (Jarosz et al. 2008; method.md section 9).
  first_order,
};

struct Settings {
  Metric metric = Metric::second_order;
  /// Of second_order: integral of the error over an extent, relative to the radiance there, units^2. Of
  /// first_order: change across a radius, relative to the radiance. > 0.
  double threshold = 0;
  Shape shape = Shape::ellipsoid;
  double maximum_anisotropy = 3;  ///< 1 to 1e4
  double maximum_radius = 0;      ///< units, > 0
  double minimum_radius = 0;      ///< units, > 0; beats every clamp and guard
  Guards guards;
};

/// Throws Error(invalid_argument, "INVALID_SETTINGS") naming the field.
void validate(const Settings& settings);

struct Ellipse {
  Vec2d axis{1, 0};  ///< unit, of the first semi-axis; the second is perpendicular
  std::array<double, 2> semi_axes{};

  double longest() const { return std::max(semi_axes[0], semi_axes[1]); }
  /// dx^T Q dx: below 1 inside, 1 on the border.
  double normalised_square(const Vec2d& offset) const {
    const double u = glm::dot(offset, axis) / semi_axes[0];
    const double v = (axis.x * offset.y - axis.y * offset.x) / semi_axes[1];
    return u * u + v * v;
  }
  /// Semi-axes times `scale`, at most `greatest`, at least `least`.
  Ellipse clamped(double scale, double greatest, double least) const;
};

/// Extent of a record by itself: metric, maximum radius, cap by the gradient (linear extrapolation stays
/// positive), visibility margin; semi-axes are at least the minimum radius. `radiance_floor` > 0: what is
/// darker counts as that.
Ellipse base_ellipse(const Settings& settings, double radiance_floor, const Record& record);

/// Greatest relative error that the metric admits anywhere in an extent: 4 eps/(pi a b) at the border
/// (method.md section 10.4) or, of first_order, the threshold; no less than 0.5 %.
double verify_tolerance(const Settings& settings, const Ellipse& ellipse);

/// What a record says about a place at `offset` from it, >= 0.
double extrapolated(const Settings& settings, const Record& record, const Vec2d& offset);

}  // namespace fogbank::cache::flatland
