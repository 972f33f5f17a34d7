// Ray queries. embree_intersector.cpp is the only file that knows Embree's API.
#pragma once

#include <memory>
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
