// Visibility of records by shadow rays.
#pragma once

#include "cache/index.h"
#include "core/ray_counters.h"
#include "scene/intersector.h"
#include "scene/scene.h"

namespace fogbank::cache {

/// Solid surfaces hide; clear ones, like boundaries of media, don't. For one thread; what is referred to must
/// outlive it.
class RayVisibility final : public VisibilityTest {
 public:
  RayVisibility(const scene::Scene& scene, RayCounters& counters) : scene_(scene), counters_(counters) {}

  bool reaches(const Vec3f& place, const Vec3f& normal, const Vec3f& point) const override;

 private:
  const scene::Scene& scene_;
  RayCounters& counters_;
};

}  // namespace fogbank::cache
