// How much light gets through a rough dielectric interface as a whole.
#pragma once

#include <algorithm>
#include <array>

#include "transport/microfacet.h"

namespace fogbank::transport {

/// Tables of `roughplastic`, for one isotropic roughness and index of refraction.
class RoughInterface {
 public:
  /// `alpha` > 0; `eta`: interior over exterior index, > 0.
  RoughInterface(MicrofacetType type, float alpha, float eta);

  /// Share of light arriving from outside at `cosine` (in [0, 1]) that single scattering by the facets lets
  /// through: the integral over visible normals of (1 - F) G1(refracted direction).
  float transmittance(float cosine) const {
    const float position = cosine * (size - 1);
    const auto index = std::min(static_cast<size_t>(position), size_t{size - 2});
    const float fraction = position - static_cast<float>(index);
    return transmittance_[index] + fraction * (transmittance_[index + 1] - transmittance_[index]);
  }
  /// Share of diffuse light from inside that is reflected back inside.
  float internal_reflectance() const { return internal_reflectance_; }

 private:
  static constexpr int size = 64;  // nodes in cos(theta), equally spaced from 0 to 1

  std::array<float, size> transmittance_{};
  float internal_reflectance_ = 0;
};

}  // namespace fogbank::transport
