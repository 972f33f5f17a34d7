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
/// Light from infinity enters through a disk in front of a target: a small sphere around a medium, or the
/// sphere around the whole scene, which gets the lines that miss all smaller targets. Immutable.
class LightEmission {
 public:
  /// Needs `scene::prepare_render_thread`. `world` must outlive it.
  explicit LightEmission(const World& world);

  /// Is there any light at all that may meet something?
  bool dark() const { return !(cumulative_.back() > 0); }
  /// nullopt where the numbers select no light. The mean of `flux` over uniform points is the power of all
  /// lights.
  std::optional<EmittedRay> sample(const EmissionPoint& u) const;
  /// u[0] selects a light, and a target of light from infinity, by these steps from 0 to 1; a guide may learn
  /// apart what lies between two of them.
  const std::vector<float>& choices() const { return cumulative_; }

 private:
  /// What u[0] selects.
  struct Choice {
    uint32_t light = 0;
    uint32_t target = 0;  ///< of light from infinity
  };

  std::optional<EmittedRay> sample_choice(const Choice& choice, const Vec2f& place,
                                          const Vec2f& direction) const;
  /// The line meets none of the targets before `target`, whose lines these are.
  bool is_of_target(const Vec3f& origin, const Vec3f& direction, uint32_t target) const;
  /// Luminance of the power that leaves a light, about.
  float power(const Light& light) const;
  int32_t medium_around(uint32_t light, const Vec3f& origin) const;

  const World& world_;
  /// Of light from infinity, each at most half the cross-section of the last: the sphere around all surfaces
  /// (radius 0: there are none).
  std::vector<scene::BoundingSphere> targets_;
  std::vector<Choice> choices_;
  std::vector<float> cumulative_;  ///< probability of choices, from 0; one more than there are
  /// The medium around each light, where all places that were tried agree; empty where lights are many.
  std::vector<std::optional<int32_t>> medium_of_light_;
};

}  // namespace fogbank::transport
