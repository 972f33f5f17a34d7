// A straight piece of a path inside one homogeneous medium, and the sampling of distances along it by
// transmittance.
#pragma once

#include "core/vector.h"
#include "scene/medium.h"
#include "transport/phase_function.h"

namespace fogbank::transport {

/// Transmittance exp(-sigma_t d) per channel; d may be infinite (then 0 where sigma_t > 0, 1 where it is 0).
inline Spectrum transmittance(const Spectrum& sigma_t, float distance) {
  if (sigma_t.x == sigma_t.y && sigma_t.y == sigma_t.z) {
    return Spectrum(sigma_t.x > 0 ? std::exp(-sigma_t.x * distance) : 1.0f);
  }
  const auto channel = [distance](float sigma) { return sigma > 0 ? std::exp(-sigma * distance) : 1.0f; };
  return {channel(sigma_t.x), channel(sigma_t.y), channel(sigma_t.z)};
}

/// Axis-aligned box around what bounds a medium; infinite when nothing does.
struct Extent {
  Vec3f lower{-infinity};
  Vec3f upper{infinity};

  /// Distance at which a ray from a point inside leaves; 0 from outside.
  float exit_distance(const Vec3f& origin, const Vec3f& direction) const {
    float exit = infinity;
    for (int axis = 0; axis < 3; ++axis) {
      if (direction[axis] == 0) continue;
      const float wall = direction[axis] > 0 ? upper[axis] : lower[axis];
      exit = std::fmin(exit, (wall - origin[axis]) / direction[axis]);
    }
    return std::fmax(exit, 0.0f);
  }
};

/// What `World` knows of a medium.
struct MediumInfo {
  Spectrum sigma_t{0};
  Spectrum sigma_s{0};
  Spectrum albedo{0};
  float mean_sigma_t = 0;
  bool grey = true;  ///< sigma_t equal in all channels
  PhaseFunction phase;
  Extent extent;
};

/// [0, length] along a ray within one medium. `channel_weights` (sum 1) are the path's throughput per
/// channel: distances are drawn from the mixture of the channels' densities with these weights (spectral
/// multiple importance sampling with the balance heuristic), which keeps the sum over channels of the
/// throughput from growing.
struct MediumSegment {
  Vec3f origin{0};
  Vec3f direction{0, 0, 1};
  float length = infinity;
  const MediumInfo* medium = nullptr;
  Vec3f channel_weights{1.0f / 3};

  /// Density per unit length of scattering at `t` under transmittance sampling.
  float scatter_pdf(float t) const {
    const Spectrum& sigma = medium->sigma_t;
    return glm::dot(channel_weights, sigma * transmittance(sigma, t));
  }
  /// Probability of passing the whole segment.
  float pass_probability() const { return glm::dot(channel_weights, transmittance(medium->sigma_t, length)); }
  /// Distance drawn by transmittance; >= length (or infinite) when the path passes. Both canonical.
  float sample_distance(float u_channel, float u_distance) const {
    float sigma = medium->sigma_t.x;
    if (!medium->grey) {
      if (u_channel >= channel_weights.x) sigma = medium->sigma_t.y;
      if (u_channel >= channel_weights.x + channel_weights.y) sigma = medium->sigma_t.z;
    }
    // 1 - u is exact for canonical numbers of 24 bits.
    return sigma > 0 ? -std::log(1 - u_distance) / sigma : infinity;
  }
};

}  // namespace fogbank::transport
