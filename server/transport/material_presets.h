// Optical constants that scene files refer to by name.
#pragma once

#include <optional>
#include <string>
#include <string_view>

#include "core/vector.h"

namespace fogbank::transport {

/// Index of refraction of a named dielectric at 589 nm (values as in Mitsuba's table, mostly from Hecht,
/// "Optics", 4th edition); names are compared without regard to case. nullopt when unknown.
std::optional<float> named_index_of_refraction(std::string_view name);
/// "acetone, acrylic glass, ..., water ice": for error messages.
std::string named_indices_of_refraction();

/// Complex index of refraction eta + i k of a conductor, per linear sRGB channel.
struct ConductorIndex {
  Spectrum eta{0};
  Spectrum k{1};
};

/// By Mitsuba's preset name (case matters: chemical symbols). Values are the measured spectra (Palik,
/// "Handbook of Optical Constants of Solids"; SOPRA database) integrated against the CIE 1931 observer under
/// equal-energy light and converted to linear sRGB with negative results clamped to 0, which is what Mitsuba
/// 3 renders in its rgb variants. "none" is the perfect mirror. nullopt when unknown.
std::optional<ConductorIndex> named_conductor(std::string_view name);
/// "Ag, Al, ...": for error messages.
std::string named_conductors();

}  // namespace fogbank::transport
