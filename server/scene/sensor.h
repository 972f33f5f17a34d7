// Cameras and the film's geometry.
#pragma once

#include <optional>

#include "core/vector.h"
#include "scene/shape.h"

namespace fogbank::scene {

enum class SensorKind : uint8_t { perspective, thinlens, orthographic };
/// What of the film a field of view is measured across, as Mitsuba's `fov_axis`.
enum class FovAxis : uint8_t { x, y, diagonal, smaller, larger };
enum class ReconstructionFilter : uint8_t { box, tent, gaussian };

/// Pixels [x, x + width) x [y, y + height); y grows downwards.
struct Window {
  int32_t x = 0;
  int32_t y = 0;
  int32_t width = 0;
  int32_t height = 0;

  bool operator==(const Window&) const = default;
};

struct Film {
  int32_t width = 768;
  int32_t height = 576;
  Window crop{0, 0, 768, 576};
  ReconstructionFilter filter = ReconstructionFilter::gaussian;
  float filter_radius =
      2.0f;  ///< box 0.5, tent 1; gaussian: 4 standard deviations (default stddev 0.5, as Mitsuba's)
  float filter_stddev = 0.5f;  ///< gaussian only
};

/// Camera. Local frame as Mitsuba's: looks along +z, +y up, image x runs to the left of +x (see sensor.cpp).
struct Sensor {
  SensorKind kind = SensorKind::perspective;
  Mat4d to_world{1.0};
  double fov_degrees = 50;  ///< over the full film, along `fov_axis`; not of orthographic cameras
  FovAxis fov_axis = FovAxis::x;
  double near_clip = 1e-2;
  double far_clip = 1e4;
  double aperture_radius = 0;  ///< thinlens
  double focus_distance = 1;   ///< thinlens
  Vec2d principal_point_offset{0, 0};
  int32_t medium = none;  ///< the medium the camera is in

  /// Camera ray through film position `position` (pixels of the full film, (0,0) the upper left corner) and
  /// lens sample `lens` in [0,1)^2. Starts at the near clip plane, as Mitsuba's does.
  Ray sample_ray(const Film& film, const Vec2f& position, const Vec2f& lens) const;

  /// Tangent of half the horizontal field of view over the full film, which for most axes depends on the
  /// film's aspect; not of orthographic cameras.
  double half_width(const Film& film) const;
  /// The horizontal field of view itself, degrees.
  double fov_x_degrees(const Film& film) const;
};

/// Offset from the pixel's centre, in pixels, drawn with density proportional to the filter; with equal
/// sample weights this reconstructs with that filter and keeps every pixel independent of its neighbours
/// (filter importance sampling, Ernst et al. 2006).
Vec2f sample_filter_offset(const Film& film, const Vec2f& u);

}  // namespace fogbank::scene
