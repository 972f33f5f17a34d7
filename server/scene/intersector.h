// Ray queries. Only embree_*.cpp know Embree's API.
#pragma once

#include <memory>
#include <span>
#include <vector>

#include "core/vector.h"
#include "scene/shape.h"

namespace fogbank::scene {

struct Scene;

/// Raw hit; `Scene::interaction` makes a SurfaceInteraction of it.
struct Hit {
  float distance = infinity;
  Vec2f parameters{0};  ///< barycentric (b1, b2) of a triangle; unused for round shapes
  uint32_t shape = 0;
  uint32_t primitive = 0;
  int32_t instance = none;
};

/// A surface seen along a ray. All in world space; both normals are unit length and NOT turned towards the
/// viewer: they point to the shape's outside (its `exterior_medium`), flipped by `flip_normals`.
struct SurfaceInteraction {
  float distance = 0;
  Vec3f position{0};
  Vec3f position_error{0};  ///< bound on the rounding error of `position`, per axis
  Vec3f geometric_normal{0, 0, 1};
  Vec3f shading_normal{0, 0, 1};
  Vec2f uv{0};
  Vec3f dp_du{1, 0, 0};
  Vec3f dp_dv{0, 1, 0};
  uint32_t shape = 0;
  uint32_t primitive = 0;

  /// Origin for a ray that leaves in `direction`: moved off the surface to the side the ray goes to, by more
  /// than the rounding error of `position`, so that the ray can't hit the surface it starts on. Scales with
  /// the scene.
  Vec3f spawn_origin(const Vec3f& direction) const;
};

/// Rays that leave one point, in an order in which neighbours have much the same direction: they are traced
/// in packets. Unit directions; `max_distances` one for each ray, or a single one for all of them.
struct RayBundle {
  Vec3f origin{0};
  std::span<const Vec3f> directions;
  std::span<const float> max_distances;

  float max_distance(size_t ray) const { return max_distances[max_distances.size() == 1 ? 0 : ray]; }
};

/// Two accelerators: solid surfaces, and surfaces that light passes through (`Shape::passes_light`). A shadow
/// ray is one any-hit query on the solid ones and then a short walk over the few others; both are
/// thread-safe. Every caller's thread must have flush-to-zero and denormals-are-zero set
/// (`prepare_render_thread`).
class Intersector {
 public:
  explicit Intersector(const Scene& scene);
  ~Intersector();
  Intersector(const Intersector&) = delete;
  Intersector& operator=(const Intersector&) = delete;

  /// Nearest surface of either kind in (0, ray.max_distance).
  bool intersect(const Ray& ray, Hit& hit) const;
  /// Is there any solid surface in (0, ray.max_distance)?
  bool occluded(const Ray& ray) const;
  /// Nearest surface that light passes through; always false when `has_passing_surfaces()` is false.
  bool intersect_passing(const Ray& ray, Hit& hit) const;
  bool has_passing_surfaces() const;

  /// Nearest solid surface in (0, ray.max_distance).
  bool intersect_solid(const Ray& ray, Hit& hit) const;

  /// The queries above for all rays of a bundle, several times as fast where rays are coherent. `hits` and
  /// `occluded` have one entry for each ray; a ray that hits nothing has an infinite distance, an occluded
  /// one has 1, others 0. A ray's answer is that of the query for it alone, whatever its neighbours, except
  /// that among surfaces at the same distance up to rounding either may be found.
  void intersect_solid(const RayBundle& bundle, std::span<Hit> hits) const;
  void intersect_passing(const RayBundle& bundle, std::span<Hit> hits) const;
  void occluded(const RayBundle& bundle, std::span<uint8_t> occluded) const;
  /// The same for rays with origins of their own, best in an order in which neighbours have much the same
  /// origin and direction.
  void occluded(std::span<const Ray> rays, std::span<uint8_t> occluded) const;

  double build_seconds() const;
  size_t memory_bytes() const;

 private:
  struct Implementation;
  std::unique_ptr<Implementation> implementation_;
};

/// Sets flush-to-zero and denormals-are-zero in this thread's MXCSR, as Embree asks; call once per render
/// thread. Results are part of "same bits": a thread without it may differ.
void prepare_render_thread();

}  // namespace fogbank::scene
