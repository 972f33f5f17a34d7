// Spectra to linear sRGB.
#pragma once

#include "core/vector.h"
#include "scene/xml/values.h"

namespace fogbank::scene {

/// Colour of an emission spectrum (per nanometre, scaled so that an equal-energy spectrum of 1 has luminance
/// 1), linear between the samples and 0 outside them. Negative channels (colours outside sRGB) become 0.
Spectrum emission_to_srgb(const SampledSpectrum& spectrum);

/// Colour of a reflectance (or another coefficient) under CIE illuminant D65: a flat spectrum v gives (v, v,
/// v). Channels are clamped to [0, largest sample], which only colours outside sRGB exceed.
Spectrum reflectance_to_srgb(const SampledSpectrum& spectrum);

/// Colour of the equal-energy emission spectrum of 1: (1.2048, 0.9483, 0.9089).
Spectrum equal_energy_white();

}  // namespace fogbank::scene
