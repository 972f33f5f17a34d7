#include "transport/light_obstacles.h"

#include <algorithm>
#include <array>
#include <utility>

namespace fogbank::transport {

namespace {

/// Share of the largest coordinate, or of the scene's radius where that is less, within which points count as
/// on a plane: vertices are rounded to single precision after `to_world`. Far from the origin that rounding
/// is larger; walls then count as obstacles, which costs rays and nothing else. Shadow rays stop short of the
/// light by 1e-4 of their length, so they don't see what is that near to it either.
constexpr double coplanar_share = 1e-6;

struct Range {
  double least = std::numeric_limits<double>::infinity();
  double most = -std::numeric_limits<double>::infinity();

  void add(double value, double half_width) {
    least = std::min(least, value - half_width);
    most = std::max(most, value + half_width);
  }
};

/// Where a light is: the hull of points, each widened by an ellipse (disks) or a ball.
struct LightHull {
  struct Point {
    Vec3d position{0};
    std::array<Vec3d, 2> axes{Vec3d(0), Vec3d(0)};
    double radius = 0;
  };
  std::vector<Point> points;
  bool flat = false;
  Vec3d normal{0};        ///< of a flat light, to where it emits
  uint32_t shape = 0;     ///< the surface it is on
  bool own_free = false;  ///< its own surface can't hide what of it faces a point

  /// Extent of normal . y over the light.
  Range along(const Vec3d& direction) const {
    Range range;
    for (const Point& point : points)
      range.add(glm::dot(direction, point.position),
                std::hypot(glm::dot(direction, point.axes[0]), glm::dot(direction, point.axes[1])) +
                    point.radius * glm::length(direction));
    return range;
  }
};

struct Triangle {
  std::array<Vec3d, 3> vertices;
  Vec3d normal;  ///< unit
  double offset = 0;
  uint32_t shape = 0;
};

Vec3d transformed(const Mat4d& m, const Vec3d& p, double w) { return {m * glm::dvec4(p, w)}; }

}  // namespace

/// Surfaces of one kind, and which of them may hide a light.
class ObstacleFinder {
 public:
  ObstacleFinder(const World& world, ObstacleKind kind) : world_(world), scene_(world.scene()) {
    for (uint32_t i = 0; i < scene_.shapes.size(); ++i) {
      const scene::Shape& shape = scene_.shapes[i];
      const bool counts = kind == ObstacleKind::passing ? shape.passes_light : !world.is_null(i);
      if (!counts) continue;
      any_ = true;
      if (shape.group != scene::none) {
        too_many_ = true;
      } else if (shape.kind != scene::ShapeKind::triangle_mesh) {
        round_.push_back(i);
      } else {
        add_mesh(i);
      }
      if (too_many_) break;
    }
  }

  std::vector<LightObstacles> find() {
    std::vector<LightObstacles> result(world_.lights().size());
    for (uint32_t light = 0; light < result.size(); ++light)
      if (world_.lights().light(light).at_infinity()) result[light].anywhere_ = any_;
    for (uint32_t light = 0; light < result.size(); ++light) {
      if (!world_.lights().light(light).is_delta() || world_.lights().light(light).at_infinity()) continue;
      LightHull hull;
      hull.points.push_back({Vec3d(world_.lights().light(light).bounds().center), {}, 0});
      hull.shape = SceneLights::no_light;
      decide(hull, result[light]);
    }
    for (uint32_t i = 0; i < scene_.shapes.size(); ++i) {
      if (scene_.shapes[i].emitter == scene::none) continue;
      const scene::Shape& shape = scene_.shapes[i];
      const size_t primitives = shape.kind == scene::ShapeKind::triangle_mesh
                                    ? scene_.meshes[static_cast<size_t>(shape.mesh)].triangles.size()
                                    : 1;
      uint32_t last = SceneLights::no_light;
      for (uint32_t primitive = 0; primitive < primitives; ++primitive) {
        const uint32_t light = world_.light_of_hit(i, primitive);
        if (light == SceneLights::no_light || light == last) continue;
        last = light;
        decide(hull_of(i, primitive, world_.lights().light(light)), result[light]);
      }
    }
    return result;
  }

 private:
  void add_mesh(uint32_t index) {
    const scene::Mesh& mesh = scene_.meshes[static_cast<size_t>(scene_.shapes[index].mesh)];
    if (triangles_.size() + mesh.triangles.size() > LightObstacles::most_triangles) {
      too_many_ = true;
      return;
    }
    for (const Vec3u& t : mesh.triangles) {
      Triangle triangle{{Vec3d(mesh.positions[t.x]), Vec3d(mesh.positions[t.y]), Vec3d(mesh.positions[t.z])},
                        Vec3d(0),
                        0,
                        index};
      const Vec3d normal = glm::cross(triangle.vertices[1] - triangle.vertices[0],
                                      triangle.vertices[2] - triangle.vertices[0]);
      const double length = glm::length(normal);
      if (!(length > 0)) continue;
      triangle.normal = normal / length;
      triangle.offset = -glm::dot(triangle.normal, triangle.vertices[0]);
      for (const Vec3d& vertex : triangle.vertices)
        for (int axis = 0; axis < 3; ++axis) largest_ = std::max(largest_, std::fabs(vertex[axis]));
      triangles_.push_back(triangle);
    }
  }

  /// `primitive` is the first of the light's; a light of a mesh is one triangle, or the mesh's one rectangle.
  LightHull hull_of(uint32_t index, uint32_t primitive, const Light& light) const {
    const scene::Shape& shape = scene_.shapes[index];
    LightHull hull;
    hull.shape = index;
    hull.own_free = true;
    switch (shape.kind) {
      case scene::ShapeKind::triangle_mesh: {
        const scene::Mesh& mesh = scene_.meshes[static_cast<size_t>(shape.mesh)];
        hull.flat = true;
        hull.normal = Vec3d(light.bounds().axis);
        hull.own_free = false;  // its other triangles are judged one by one
        const bool whole =
            mesh.triangles.size() == 2 && world_.light_of_hit(index, 1) == world_.light_of_hit(index, 0);
        const Vec3u& t = mesh.triangles[primitive];
        if (whole) {
          for (const Vec3f& p : mesh.positions) hull.points.push_back({Vec3d(p), {}, 0});
        } else {
          for (const uint32_t v : {t.x, t.y, t.z}) hull.points.push_back({Vec3d(mesh.positions[v]), {}, 0});
        }
        break;
      }
      case scene::ShapeKind::disk:
        hull.flat = true;
        hull.normal = Vec3d(light.bounds().axis);
        hull.points.push_back(
            {transformed(shape.to_world, Vec3d(0), 1),
             {transformed(shape.to_world, {1, 0, 0}, 0), transformed(shape.to_world, {0, 1, 0}, 0)},
             0});
        break;
      case scene::ShapeKind::sphere:
        hull.points.push_back({Vec3d(light.bounds().center), {}, light.bounds().radius});
        break;
      case scene::ShapeKind::cylinder:
        for (const double z : {0.0, 1.0})
          hull.points.push_back(
              {transformed(shape.to_world, {0, 0, z}, 1),
               {transformed(shape.to_world, {1, 0, 0}, 0), transformed(shape.to_world, {0, 1, 0}, 0)},
               0});
        // Through an open end one sees the inner wall behind the outer one.
        hull.own_free = !shape.flip_normals;
        break;
    }
    return hull;
  }

  void decide(const LightHull& hull, LightObstacles& result) const {
    result.anywhere_ = too_many_;
    for (const uint32_t shape : round_)
      if (shape != hull.shape || !hull.own_free) result.anywhere_ = true;
    if (result.anywhere_) return;
    const double tolerance = coplanar_share * std::min(largest_, static_cast<double>(scene_.bounds.radius));
    const double light_offset = hull.flat ? -glm::dot(hull.normal, hull.points.front().position) : 0;
    for (const Triangle& triangle : triangles_) {
      if (hull.flat && std::all_of(triangle.vertices.begin(), triangle.vertices.end(), [&](const Vec3d& v) {
            return glm::dot(hull.normal, v) + light_offset <= tolerance;
          }))
        continue;
      const Range range = hull.along(triangle.normal);
      const double least = range.least + triangle.offset;
      const double most = range.most + triangle.offset;
      if (least >= -tolerance && most <= tolerance) continue;
      const double side = least >= -tolerance ? 1 : -1;
      if (side < 0 && most > tolerance) {
        result.anywhere_ = true;
        return;
      }
      const LightObstacles::HalfSpace half{side * triangle.normal, side * triangle.offset};
      const bool known =
          std::any_of(result.free_where_.begin(), result.free_where_.end(), [&](const auto& h) {
            return glm::length(h.normal - half.normal) < 1e-12 &&
                   std::fabs(h.offset - half.offset) < 1e-12 * largest_;
          });
      if (!known) result.free_where_.push_back(half);
    }
  }

  const World& world_;
  const scene::Scene& scene_;
  std::vector<Triangle> triangles_;
  std::vector<uint32_t> round_;
  double largest_ = 0;
  bool any_ = false;
  bool too_many_ = false;
};

std::vector<LightObstacles> LightObstacles::of_all(const World& world, ObstacleKind kind) {
  return ObstacleFinder(world, kind).find();
}

}  // namespace fogbank::transport
