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
#include "cache/directional_shape.h"
#include "core/symmetric.h"
#include "core/vector.h"

namespace fogbank::cache {

/// What a record's value is.
enum class Quantity : uint8_t {
  /// M_rest: mean radiance (fluence / 4 pi) at a point of a medium of all light that doesn't come straight
  /// from an
  /// emitter, W/(m^2 sr).
  rest,
  /// E_rest / pi at a surface: what a white Lambertian surface of normal Record::normal would send out of the
  /// light
  /// that doesn't come straight from an emitter, W/(m^2 sr).
  irradiance,
  /// rho = M / Mhat of the light group's emitter: share of its closed-form unoccluded proxy that arrives
  /// (ratio-records.md section 1); grey for lights of constant colour. Record::proxy is Mhat's luminance.
  ratio,
  /// `rest` as the occlusion-unaware rival makes it, with its radius and extrapolation (Jarosz et al. 2008;
  /// method.md section 9): no Hessian, Record::proxy is the length of change.
  unaware_rest,
  /// Mean radiance straight from emitters, as the rival makes it.
  unaware_direct,
  /// `rest` in a medium that scatters by another phase function than the isotropic one, with Record::shape.
  directional_rest,
};
inline constexpr Quantity last_quantity = Quantity::directional_rest;

/// Whether records hold how their light is spread over directions.
constexpr bool has_shape(Quantity quantity) { return quantity == Quantity::directional_rest; }

/// Whether a quantity has the rival's radius of first order and extrapolation of the logarithm.
constexpr bool is_unaware(Quantity quantity) {
  return quantity == Quantity::unaware_rest || quantity == Quantity::unaware_direct;
}

/// The part of the light field that a record describes. Records of different components are never mixed.
struct Component {
  int32_t medium = 0;        ///< index of the medium that holds the place, as transport::medium_at names it
  uint16_t light_group = 0;  ///< lights whose emission scales together; of `ratio`: the emitter's index
  /// Generation: 0: of whole paths, 1: of paths that end among photons (photon_field.h).
  uint8_t scattering_order = 0;
  Quantity quantity = Quantity::rest;

  friend auto operator<=>(const Component&, const Component&) = default;
};

/// Immutable once made. Numbers are finite and of the ranges given; RecordSet refuses others.
struct Record {
  uint64_t id = 0;    ///< content_id of all that determines the rest
  Vec3f position{0};  ///< world space
  Component component;
  Spectrum radiance{0};             ///< the component's quantity, >= 0
  std::array<Vec3f, 3> gradient{};  ///< of each channel of it, per scene unit
  Symmetric3f hessian;              ///< of its luminance, per scene unit squared
  Vec3f normal{0};                  ///< Quantity::irradiance: unit, of the surface; else 0
  /// Quantity::ratio: luminance of Mhat. Of is_unaware(): length of change sum |L_i| / sum |grad L_i| over
  /// the samples, scene units. Else 0. >= 0.
  float proxy = 0;
  DepthBins depth;  ///< distance to the nearest surface, by direction
  /// Distance to the next visibility event of a directly sampled light, > 0; infinity where there is none
  /// (guard 2 of method.md section 10.4 in the exact form of ratio-records.md section 2).
  float visibility_margin = std::numeric_limits<float>::infinity();
  uint32_t samples = 1;    ///< rays behind the estimate, >= 1; weight among records of the same place
  float variance = 0;      ///< of the estimate of the luminance of `radiance`, >= 0
  DirectionalShape shape;  ///< where has_shape(); else even
};

/// 64-bit hash of what determines a record. `settings` is a fingerprint of the estimator and its settings,
/// `seed` selects its random numbers: records with different ids are independent estimates.
uint64_t content_id(const Vec3f& position, const Component& component, const std::string& settings,
                    uint64_t seed);

/// Throws Error(invalid_argument, "INVALID_RECORD") naming the field that isn't finite or out of range.
void validate(const Record& record);

/// The record as sets and files keep it: normal to 7e-5 radians (packed_normal.h), visibility margin rounded
/// down to 8 bits of mantissa, -0 in positions as 0. Idempotent.
Record canonical(const Record& record);

/// What of a quantity's records is particular to it: the packed normal, the proxy's bits or nothing (0).
bool has_particular(Quantity quantity);
uint32_t pack_particular(const Record& record);
void unpack_particular(uint32_t packed, Record& record);
/// Visibility margins, > 0, as the upper half of their bits.
uint16_t pack_margin(float margin);
float unpack_margin(uint16_t packed);

}  // namespace fogbank::cache
