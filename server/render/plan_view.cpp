#include "render/plan_view.h"

#include <algorithm>
#include <cmath>
#include <set>
#include <string>

#include "core/error.h"
#include "scene/intersector.h"

namespace fogbank::render {

namespace {

/// Cells of the grid on which the picture's border is looked for.
constexpr int32_t coarse_cells = 96;
/// Blank border, as a share of the longer side.
constexpr double margin = 0.03;
/// Of `points` that are asked what encloses them.
constexpr size_t most_tested_points = 500;

struct Axes {
  int32_t right, down, up;
};

/// Cyclic, so that the picture isn't mirrored.
Axes axes_of(int32_t up) { return {.right = (up + 2) % 3, .down = (up + 1) % 3, .up = up}; }

Vec3f unit(int32_t axis, float sign) {
  Vec3f direction(0);
  direction[axis] = sign;
  return direction;
}

struct Rectangle {
  double left = infinity, right = -infinity, top = infinity, bottom = -infinity;

  bool empty() const { return left > right; }
  void add(double x, double y) {
    left = std::min(left, x);
    right = std::max(right, x);
    top = std::min(top, y);
    bottom = std::max(bottom, y);
  }
};

class Drawing {
 public:
  Drawing(const scene::Scene& scene, const Axes& axes, double cut) : scene_(scene), axes_(axes), cut_(cut) {}

  struct Seen {
    float distance = infinity;
    float facing = 0;  ///< cosine between normal and the way back, signed
    int32_t shape = scene::none;
  };

  Vec3f at_cut(double x, double y) const {
    Vec3f point;
    point[axes_.right] = static_cast<float>(x);
    point[axes_.down] = static_cast<float>(y);
    point[axes_.up] = static_cast<float>(cut_);
    return point;
  }

  Seen look(const Vec3f& from, float sign) const {
    const Vec3f direction = unit(axes_.up, sign);
    const Ray ray{.origin = from, .direction = direction, .max_distance = infinity};
    scene::Hit hit;
    if (!scene_.intersector || !scene_.intersector->intersect_solid(ray, hit)) return {};
    const scene::SurfaceInteraction surface = scene_.interaction(ray, hit);
    return {.distance = hit.distance,
            .facing = -dot(surface.geometric_normal, direction),
            .shape = static_cast<int32_t>(surface.shape)};
  }

  /// The shape that both surfaces above and below belong to, both seen from their inside; `none` in free
  /// space.
  int32_t enclosing(const Vec3f& point, const Seen& below) const {
    if (below.facing >= 0) return scene::none;
    const Seen above = look(point, 1);
    return above.facing < 0 && above.shape == below.shape ? above.shape : scene::none;
  }

 private:
  const scene::Scene& scene_;
  Axes axes_;
  double cut_;
};

int32_t up_axis_of(const scene::Scene& scene, const PlanRequest& request) {
  if (request.up_axis) {
    if (*request.up_axis < 0 || *request.up_axis > 2)
      throw Error(ErrorKind::invalid_argument, "INVALID_VIEW", "up_axis: must be 0, 1 or 2");
    return *request.up_axis;
  }
  const Vec3d up(scene.sensor.to_world[1]);
  int32_t axis = 0;
  for (int32_t k = 1; k < 3; ++k) {
    if (std::fabs(up[k]) > std::fabs(up[axis])) axis = k;
  }
  return axis;
}

double cut_of(const scene::Scene& scene, std::span<const Vec3f> points, int32_t up,
              const PlanRequest& request) {
  if (request.cut) {
    if (!std::isfinite(*request.cut))
      throw Error(ErrorKind::invalid_argument, "INVALID_VIEW", "cut: is not finite");
    return *request.cut;
  }
  if (points.empty()) return static_cast<double>(scene.bounds.center[up]);
  std::vector<float> heights;
  heights.reserve(points.size());
  for (const Vec3f& point : points) heights.push_back(point[up]);
  const auto middle = heights.begin() + static_cast<std::ptrdiff_t>(heights.size() / 2);
  std::ranges::nth_element(heights, middle);
  return static_cast<double>(*middle);
}

/// What is to be seen: surfaces below the cut, found on a coarse grid, and points.
Rectangle content(const scene::Scene& scene, const Drawing& drawing, const Axes& axes,
                  std::span<const Vec3f> points) {
  Rectangle found;
  const auto radius = static_cast<double>(scene.bounds.radius);
  const double cell = 2 * radius / coarse_cells;
  for (int32_t row = 0; row < coarse_cells && radius > 0; ++row) {
    for (int32_t column = 0; column < coarse_cells; ++column) {
      const double x = static_cast<double>(scene.bounds.center[axes.right]) - radius + (column + 0.5) * cell;
      const double y = static_cast<double>(scene.bounds.center[axes.down]) - radius + (row + 0.5) * cell;
      if (drawing.look(drawing.at_cut(x, y), -1).shape == scene::none) continue;
      found.add(x - cell, y - cell);
      found.add(x + cell, y + cell);
    }
  }
  for (const Vec3f& point : points) {
    found.add(static_cast<double>(point[axes.right]), static_cast<double>(point[axes.down]));
  }
  const Vec3d camera(scene.sensor.to_world[3]);
  if (found.empty()) found.add(camera[axes.right], camera[axes.down]);
  return found;
}

/// Shapes that points in free space lie inside of.
std::set<int32_t> rooms(const Drawing& drawing, std::span<const Vec3f> points) {
  std::set<int32_t> found;
  const size_t stride = points.size() / most_tested_points + 1;
  for (size_t i = 0; i < points.size(); i += stride)
    found.insert(drawing.enclosing(points[i], drawing.look(points[i], -1)));
  return found;
}

}  // namespace

PlanView plan_view(const scene::Scene& scene, std::span<const Vec3f> points, const PlanRequest& request) {
  if (request.side < 1) throw Error(ErrorKind::invalid_argument, "INVALID_VIEW", "side: must be at least 1");
  scene::prepare_render_thread();
  const Axes axes = axes_of(up_axis_of(scene, request));
  PlanView view;
  view.right_axis = axes.right;
  view.down_axis = axes.down;
  view.up_axis = axes.up;
  view.cut = cut_of(scene, points, axes.up, request);
  const Drawing drawing(scene, axes, view.cut);
  const Rectangle inside = content(scene, drawing, axes, points);
  const double longer = std::max({inside.right - inside.left, inside.bottom - inside.top, 1e-6});
  view.pixel_size = longer * (1 + 2 * margin) / request.side;
  view.left = inside.left - margin * longer;
  view.top = inside.top - margin * longer;
  const auto pixels = [&](double length) {
    return std::clamp(static_cast<int32_t>(std::ceil((length + 2 * margin * longer) / view.pixel_size)), 1,
                      request.side);
  };
  view.width = pixels(inside.right - inside.left);
  view.height = pixels(inside.bottom - inside.top);

  std::vector<Vec3f> free(points.begin(), points.end());
  free.push_back(Vec3f(Vec3d(scene.sensor.to_world[3])));
  const std::set<int32_t> enclosing_rooms = rooms(drawing, free);
  const auto count = static_cast<size_t>(view.width) * static_cast<size_t>(view.height);
  view.depth.reserve(count);
  view.facing.reserve(count);
  view.solid.reserve(count);
  for (int32_t row = 0; row < view.height; ++row) {
    for (int32_t column = 0; column < view.width; ++column) {
      const Vec3f from = drawing.at_cut(view.left + (column + 0.5) * view.pixel_size,
                                        view.top + (row + 0.5) * view.pixel_size);
      const Drawing::Seen below = drawing.look(from, -1);
      const int32_t enclosing = drawing.enclosing(from, below);
      view.depth.push_back(below.distance);
      view.facing.push_back(std::min(std::fabs(below.facing), 1.0f));
      view.solid.push_back(enclosing != scene::none && !enclosing_rooms.contains(enclosing) ? 1 : 0);
    }
  }
  return view;
}

}  // namespace fogbank::render
