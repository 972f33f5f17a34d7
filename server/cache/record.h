// What the radiance cache is made of: one estimate of the mean incoming radiance at a point, with its
// derivatives. A record is a property of the scene, never of a camera, and holds no radius: extents follow
// from the error threshold at look-up (metric.h).
#pragma once

#include <array>
#include <compare>
#include <cstdint>
#include <limits>
#include <string>

#include "cache/depth_bins.h"
#include "core/symmetric.h"
#include "core/vector.h"

namespace fogbank::cache {

/// The part of the light field that a record describes. Records of different components are never mixed.
struct Component {
  int32_t medium = 0;        ///< index of the medium that holds the place, as transport::medium_at names it
  uint16_t light_group = 0;  ///< lights whose emission scales together
  uint16_t scattering_order = 0;  ///< 0: light that comes from surfaces and emitters; k: scattered k times

  friend auto operator<=>(const Component&, const Component&) = default;
};

/// Immutable once made. Numbers are finite and of the ranges given; RecordSet refuses others.
struct Record {
  uint64_t id = 0;    ///< content_id of all that determines the rest
  Vec3f position{0};  ///< world space
  Component component;
  Spectrum radiance{0};             ///< M, mean incoming radiance = fluence / 4 pi, >= 0, W/(m^2 sr)
  std::array<Vec3f, 3> gradient{};  ///< of each channel of M, per scene unit
  Symmetric3f hessian;              ///< of the luminance of M, per scene unit squared
  DepthBins depth;                  ///< distance to the nearest surface, by direction
  /// Distance to the next visibility event of a directly sampled light, > 0; infinity where there is none
  /// (guard 2 of method.md section 10.4 in the exact form of ratio-records.md section 2).
  float visibility_margin = std::numeric_limits<float>::infinity();
  uint32_t samples = 1;  ///< rays behind the estimate, >= 1; weight among records of the same place
  float variance = 0;    ///< of the estimate of the luminance of M, >= 0
};

/// 64-bit hash of what determines a record. `settings` is a fingerprint of the estimator and its settings,
/// `seed` selects its random numbers: records with different ids are independent estimates.
uint64_t content_id(const Vec3f& position, const Component& component, const std::string& settings,
                    uint64_t seed);

/// Throws Error(invalid_argument, "INVALID_RECORD") naming the field that isn't finite or out of range.
void validate(const Record& record);

}  // namespace fogbank::cache
