// Bundles of rays with one origin, traced as Embree packets. For embree_*.cpp alone.
#pragma once

#include <embree3/rtcore.h>

#include <bit>
#include <cstdint>
#include <span>

#include "scene/intersector.h"

namespace fogbank::scene {

/// Embree's intervals are closed, ours are open. The start is no denormal, and leaves room for a product with
/// a small triangle's area.
inline constexpr float open_start = 0x1p-90f;
/// Largest float below a positive `distance`.
inline float open_end(float distance) { return std::bit_cast<float>(std::bit_cast<uint32_t>(distance) - 1u); }

/// What Embree says of a ray that hit something, in its own numbers.
struct RawHit {
  float distance = 0;
  Vec2f parameters{0};
  uint32_t primitive = 0;
  uint32_t geometry = RTC_INVALID_GEOMETRY_ID;  ///< RTC_INVALID_GEOMETRY_ID: nothing was hit
  uint32_t instance = RTC_INVALID_GEOMETRY_ID;
};

/// Nearest surfaces with `mask` along `bundle`; `hits` has as many entries as the bundle has rays.
void intersect_packets(RTCScene scene, const RayBundle& bundle, uint32_t mask, std::span<RawHit> hits);

/// 1 where any surface with `mask` lies within a ray's interval, else 0; as many entries as rays.
void occluded_packets(RTCScene scene, const RayBundle& bundle, uint32_t mask, std::span<uint8_t> occluded);
void occluded_packets(RTCScene scene, std::span<const Ray> rays, uint32_t mask, std::span<uint8_t> occluded);

}  // namespace fogbank::scene
