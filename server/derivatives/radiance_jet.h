// Mean incoming radiance with its derivatives, per colour channel.
#pragma once

#include <array>

#include "core/vector.h"
#include "derivatives/jet.h"

namespace fogbank::derivatives {

/// Weights of relative luminance of linear sRGB (ITU-R BT.709), as `luminance` in core/vector.h.
inline constexpr std::array<double, 3> luminance_weights{0.212671, 0.715160, 0.072169};

/// Radiance (W/m^2/sr up to the scene's scale), gradient (per scene unit) and Hessian (per scene unit
/// squared) of each channel of linear sRGB.
struct RadianceJet {
  std::array<Jet3d, 3> channels{};

  RadianceJet& operator+=(const RadianceJet& other) {
    for (size_t c = 0; c < 3; ++c) channels[c] += other.channels[c];
    return *this;
  }
  RadianceJet& operator*=(double scale) {
    for (Jet3d& channel : channels) channel *= scale;
    return *this;
  }
  /// Adds a field that has the same shape in all channels.
  void add(const Jet3d& field, const Spectrum& weight) {
    for (int c = 0; c < 3; ++c) channels[static_cast<size_t>(c)] += field * static_cast<double>(weight[c]);
  }
  Jet3d luminance() const {
    Jet3d sum;
    for (size_t c = 0; c < 3; ++c) sum += channels[c] * luminance_weights[c];
    return sum;
  }
};

}  // namespace fogbank::derivatives
