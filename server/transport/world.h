// A scene made ready for light transport: BSDFs, lights, phase functions and the light sampler built over
// `scene::Scene`.
#pragma once

#include <memory>
#include <span>
#include <vector>

#include "core/ray_counters.h"
#include "scene/scene.h"
#include "transport/bsdf.h"
#include "transport/light_sampler.h"
#include "transport/lights/light_registry.h"
#include "transport/medium_segment.h"

namespace fogbank::transport {

/// Shadow rays stop short of the light by this share of their length, so that they don't meet the light
/// itself: rounding of a light's point moves it by some 1e-6 of the distances involved, more at grazing
/// angles.
inline constexpr float shadow_share = 1.0f - 1e-4f;

class World {
 public:
  /// Builds everything `scene` describes. Throws SceneError as `BsdfBuilder`, `build_lights` and
  /// `build_phase_function` do; lenient scenes get their substitutions' warnings appended to
  /// `scene->warnings`.
  explicit World(std::shared_ptr<scene::Scene> scene);

  const scene::Scene& scene() const { return *scene_; }
  /// Surfaces without any effect on light (BSDF of type null), like those that only bound a medium.
  bool is_null(uint32_t shape) const {
    return scene_->bsdfs[static_cast<size_t>(scene_->shapes[shape].bsdf)]->type == "null";
  }
  const Bsdf& bsdf(uint32_t shape) const { return *bsdfs_[static_cast<size_t>(scene_->shapes[shape].bsdf)]; }
  const LightSampler& lights() const { return *light_sampler_; }
  /// Light of a hit surface; SceneLights::no_light when it doesn't emit.
  uint32_t light_of_hit(uint32_t shape, uint32_t primitive) const {
    return lights_of_.of_hit(shape, primitive);
  }
  /// The lights at infinity that a ray may meet (not directional ones).
  const std::vector<uint32_t>& environments() const { return environments_; }
  const MediumInfo& medium(int32_t index) const { return media_[static_cast<size_t>(index)]; }

  /// Medium on the side of a surface that `direction` leaves to; `current` where the surface bounds none.
  int32_t medium_beyond(const scene::SurfaceInteraction& surface, const Vec3f& direction,
                        int32_t current) const {
    const scene::Shape& shape = scene_->shapes[surface.shape];
    if (!shape.is_medium_boundary) return current;
    return glm::dot(direction, surface.geometric_normal) > 0 ? shape.exterior_medium : shape.interior_medium;
  }

  /// Medium around a point in free space, scene::none in vacuum. Rays in fixed directions go to the nearest
  /// surface that bounds a medium, through all that bound none, and the side they meet decides by majority; a
  /// point that no such ray finds a boundary from asks rays aimed at the boundaries themselves. Where nothing
  /// bounds a medium it is the sensor's. Inside a closed object that bounds no medium the answer is the
  /// medium around the object: a surface with nothing said of its two sides (the walls of a room, a statue)
  /// doesn't tell which is the inside. Needs `scene::prepare_render_thread`. About ten rays: ask once a
  /// point.
  int32_t medium_at(const Vec3f& x) const;

  /// What a BSDF looks at.
  static ShadingPoint shading_point(const scene::SurfaceInteraction& surface) {
    return {Frame::from_normal_and_tangent(surface.shading_normal, surface.dp_du), surface.geometric_normal,
            surface.uv, surface.dp_du, surface.dp_dv};
  }

  /// Transmittance between `origin` (in `medium`, already off any surface) and the point at `distance` along
  /// `direction`: 0 behind solid surfaces, through media and surfaces that pass light straight on.
  Spectrum visibility(const Vec3f& origin, const Vec3f& direction, float distance, int32_t medium,
                      RayCounters& counters) const;
  /// The same for several rays at once, in an order in which neighbours are alike: their ends are
  /// `max_distance` away. One entry of `visible` each.
  void visibility(std::span<const Ray> rays, int32_t medium, std::span<Spectrum> visible,
                  RayCounters& counters) const;
  /// The same without asking for solid surfaces.
  Spectrum unblocked_transmittance(const Vec3f& origin, const Vec3f& direction, float distance,
                                   int32_t medium, RayCounters& counters) const;

 private:
  std::shared_ptr<scene::Scene> scene_;
  std::vector<BsdfPointer> bsdfs_;
  SceneLights lights_of_;
  std::unique_ptr<LightSampler> light_sampler_;
  std::vector<uint32_t> environments_;
  std::vector<MediumInfo> media_;
  std::vector<Vec3f> boundary_points_;  ///< on surfaces that bound a medium, some; empty when none does
};

}  // namespace fogbank::transport
