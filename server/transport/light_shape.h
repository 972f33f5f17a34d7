// What lights are geometrically, for those who integrate over them in closed form instead of sampling them.
#pragma once

#include <array>
#include <cstdint>
#include <variant>

#include "core/vector.h"
#include "scene/texture.h"

namespace fogbank::transport {

/// Rectangle (right angles) that emits towards edge_x x edge_y. `uvs`: at corner, corner + edge_x, corner +
/// edge_y. Radiances are never null: W/m^2/sr, as a function of the shape's uv.
struct RectangleShape {
  Vec3f corner{0};
  Vec3f edge_x{0};
  Vec3f edge_y{0};
  std::array<Vec2f, 3> uvs{};
  const scene::Texture* radiance = nullptr;
};

/// Vertices counter-clockwise seen from the emitting side.
struct TriangleShape {
  std::array<Vec3f, 3> vertices{};
  std::array<Vec2f, 3> uvs{};
  const scene::Texture* radiance = nullptr;
};

/// Emits outwards, or inwards when `inwards`. uv = (azimuth / 2 pi, polar angle / pi) of `to_local` * normal.
struct SphereShape {
  Vec3f center{0};
  float radius = 0;
  bool inwards = false;
  Mat3f to_local{1};
  const scene::Texture* radiance = nullptr;
};

/// center + p.x axis_x + p.y axis_y, |p| <= 1; emits towards `normal` (unit). uv = (|p|, azimuth of p / 2
/// pi).
struct DiskShape {
  Vec3f center{0};
  Vec3f axis_x{0};
  Vec3f axis_y{0};
  Vec3f normal{0, 0, 1};
  const scene::Texture* radiance = nullptr;
};

/// Open cylinder around base + t axis, 0 <= t <= length; axes are unit vectors. uv = (azimuth / 2 pi, t /
/// length), azimuth 0 at axis_x and a quarter turn at axis_y.
struct CylinderShape {
  Vec3f base{0};
  Vec3f axis{0, 0, 1};
  Vec3f axis_x{1, 0, 0};
  Vec3f axis_y{0, 1, 0};
  float length = 0;
  float radius = 0;
  bool inwards = false;
  const scene::Texture* radiance = nullptr;
};

/// Point of `intensity` (W/sr) within `beam_width` of `axis`, falling linearly in angle to 0 at
/// `cutoff_angle`; for a point light both are pi or more.
struct PointShape {
  Vec3f position{0};
  Spectrum intensity{0};
  Vec3f axis{0, 0, 1};
  float beam_width = 2 * pi;
  float cutoff_angle = 2 * pi;
};

/// Parallel light travelling along `direction`; irradiance across it in W/m^2.
struct DirectionalShape {
  Vec3f direction{0, 0, 1};
  Spectrum irradiance{0};
};

/// The same radiance from everywhere.
struct ConstantShape {
  Spectrum radiance{0};
};

/// Latitude-longitude image of `columns` x `rows` cells: cell (i, j) is centred at azimuth u = (i + 1/2) /
/// columns and polar angle v = (j + 1/2) / rows, in the local frame of EnvironmentLight. Radiance by
/// Light::emitted.
struct ImageShape {
  int32_t columns = 0;
  int32_t rows = 0;
  Mat3f to_world{1};
};

using LightShape = std::variant<RectangleShape, TriangleShape, SphereShape, DiskShape, CylinderShape,
                                PointShape, DirectionalShape, ConstantShape, ImageShape>;

}  // namespace fogbank::transport
