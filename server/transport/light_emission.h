// Light leaving the emitters: where paths of photons begin.
#pragma once

#include <array>
#include <optional>
#include <vector>

#include "transport/world.h"

namespace fogbank::transport {

/// Canonical numbers that select an emitted ray: the light; a place on it, or across its direction; a
/// direction.
inline constexpr size_t emission_dimensions = 5;
using EmissionPoint = std::array<float, emission_dimensions>;

struct EmittedRay {
  Vec3f origin{0};
  Vec3f direction{0, 0, 1};
  Spectrum flux{0};              ///< W: emitted power over the density of the ray
  int32_t medium = scene::none;  ///< that holds the origin
};

/// Rays from lights that are chosen half by power, half evenly, then by area and cosine or by direction.
/// Light from infinity enters through a disk around the scene's bounding sphere. Immutable.
class LightEmission {
 public:
  /// Needs `scene::prepare_render_thread`. `world` must outlive it.
  explicit LightEmission(const World& world);

  /// Is there any light at all that may meet something?
  bool dark() const { return !(cumulative_.back() > 0); }
  /// nullopt where the numbers select no light. The mean of `flux` over uniform points is the power of all
  /// lights.
  std::optional<EmittedRay> sample(const EmissionPoint& u) const;

 private:
  std::optional<EmittedRay> sample_light(uint32_t light, const Vec2f& place, const Vec2f& direction) const;
  /// Luminance of the power that leaves a light, about.
  float power(const Light& light) const;
  int32_t medium_around(uint32_t light, const Vec3f& origin) const;

  const World& world_;
  Vec3f center_{0};
  float radius_ = 0;               ///< of a sphere around all surfaces; 0: there are none
  std::vector<float> cumulative_;  ///< probability of lights, from 0; one more than there are
  /// The medium around each light, where all places that were tried agree; empty where lights are many.
  std::vector<std::optional<int32_t>> medium_of_light_;
};

}  // namespace fogbank::transport
