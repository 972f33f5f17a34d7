// Numbers and colours as scene files write them.
#pragma once

#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "core/vector.h"

namespace fogbank::scene {

std::string_view trim(std::string_view text);

/// Decimal number, whitespace around it and a leading '+' allowed; "inf" and "nan" are read as such. Too
/// small a number becomes 0, too large a one infinity. nullopt when anything else is there.
std::optional<double> parse_number(std::string_view text);
std::optional<int64_t> parse_integer(std::string_view text);
/// "true" or "false" in any case.
std::optional<bool> parse_boolean(std::string_view text);

/// Numbers separated by blanks and/or one comma each.
std::optional<std::vector<double>> parse_numbers(std::string_view text);

/// One number (grey), three numbers, or "#rrggbb" with each pair over 255.
std::optional<Vec3d> parse_colour(std::string_view text);

/// "wavelength:value, ..." with wavelengths in nanometres, ascending; at least two.
struct SampledSpectrum {
  std::vector<double> wavelengths;
  std::vector<double> values;
};
std::optional<SampledSpectrum> parse_sampled_spectrum(std::string_view text);

/// sRGB transfer function, decoding (IEC 61966-2-1).
double srgb_to_linear(double value);

}  // namespace fogbank::scene
