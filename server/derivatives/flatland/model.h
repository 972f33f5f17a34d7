// The two-dimensional model as a whole: one scene, one way of asking, any number of points.
#pragma once

#include <memory>

#include "derivatives/flatland/settings.h"
#include "derivatives/flatland/source.h"

namespace fogbank::derivatives::flatland {

/// Limits. Points of a march are samples times steps of the scene's reach; each asks for single scattering.
inline constexpr int32_t smallest_sample_count = 4;
inline constexpr int32_t largest_sample_count = 1 << 16;
inline constexpr int32_t largest_bisection_count = 40;
inline constexpr int64_t largest_march_points = 1 << 20;

/// Immutable; serves any number of threads.
class Model {
 public:
  /// The medium is lit by single scattering: Order::multiple is double scattering. Throws
  /// Error(invalid_argument): "INVALID_SCENE" or "INVALID_SETTINGS", naming the field;
  /// Error(resource_exhausted, "TOO_MANY_CREASES") for the exact method of multiple scattering.
  Model(const SceneDescription& scene, const Settings& settings);
  Model(Model&& other) noexcept;
  ~Model();

  /// A pure function of scene, settings and x. All numbers are finite. Throws Error(invalid_argument,
  /// "INVALID_POINT").
  Estimate estimate(const Vec2d& x) const;

  const Scene& scene() const;
  /// With every default filled in.
  const Settings& settings() const;

 private:
  struct Parts;
  std::unique_ptr<const Parts> parts_;
};

}  // namespace fogbank::derivatives::flatland
