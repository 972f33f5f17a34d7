#include "scene/xml/values.h"

#include <charconv>
#include <cmath>

namespace fogbank::scene {
namespace {

bool is_blank(char c) { return c == ' ' || c == '\t' || c == '\n' || c == '\r'; }

/// Splits at blanks and commas; two commas in a row or one at an end make an empty, hence unreadable, token.
std::vector<std::string_view> split_list(std::string_view text) {
  std::vector<std::string_view> tokens;
  text = trim(text);
  size_t i = 0;
  while (i < text.size()) {
    const size_t begin = i;
    while (i < text.size() && !is_blank(text[i]) && text[i] != ',') ++i;
    tokens.push_back(text.substr(begin, i - begin));
    while (i < text.size() && is_blank(text[i])) ++i;
    if (i < text.size() && text[i] == ',') {
      ++i;
      while (i < text.size() && is_blank(text[i])) ++i;
      if (i == text.size()) tokens.emplace_back();
    }
  }
  return tokens;
}

}  // namespace

std::string_view trim(std::string_view text) {
  while (!text.empty() && is_blank(text.front())) text.remove_prefix(1);
  while (!text.empty() && is_blank(text.back())) text.remove_suffix(1);
  return text;
}

std::optional<double> parse_number(std::string_view text) {
  text = trim(text);
  if (text.starts_with('+')) {
    text.remove_prefix(1);
    if (text.starts_with('-') || text.starts_with('+')) return std::nullopt;
  }
  double value = 0;
  const auto result = std::from_chars(text.data(), text.data() + text.size(), value);
  if (text.empty() || result.ptr != text.data() + text.size()) return std::nullopt;
  if (result.ec == std::errc::result_out_of_range) {
    // from_chars does not say in which direction. The exponent's sign does; without one only digits behind
    // "0." can make a number too small.
    const bool is_negative = text.starts_with('-');
    if (is_negative) text.remove_prefix(1);
    const size_t exponent = text.find_first_of("eE");
    const bool is_small = exponent == std::string_view::npos ? text.starts_with('.') || text.starts_with("0.")
                                                             : text.substr(exponent + 1).starts_with('-');
    const double magnitude = is_small ? 0.0 : std::numeric_limits<double>::infinity();
    return is_negative ? -magnitude : magnitude;
  }
  if (result.ec != std::errc()) return std::nullopt;
  return value;
}

std::optional<int64_t> parse_integer(std::string_view text) {
  text = trim(text);
  if (text.starts_with('+') && text.size() > 1 && text[1] >= '0' && text[1] <= '9') text.remove_prefix(1);
  int64_t value = 0;
  const auto result = std::from_chars(text.data(), text.data() + text.size(), value);
  if (text.empty() || result.ec != std::errc() || result.ptr != text.data() + text.size())
    return std::nullopt;
  return value;
}

std::optional<bool> parse_boolean(std::string_view text) {
  std::string lower;
  for (const char c : trim(text)) lower += c >= 'A' && c <= 'Z' ? static_cast<char>(c - 'A' + 'a') : c;
  if (lower == "true") return true;
  if (lower == "false") return false;
  return std::nullopt;
}

std::optional<std::vector<double>> parse_numbers(std::string_view text) {
  std::vector<double> numbers;
  for (const std::string_view token : split_list(text)) {
    const std::optional<double> number = parse_number(token);
    if (!number) return std::nullopt;
    numbers.push_back(*number);
  }
  return numbers;
}

std::optional<Vec3d> parse_colour(std::string_view text) {
  text = trim(text);
  if (text.starts_with('#')) {
    uint32_t code = 0;
    const auto result = std::from_chars(text.data() + 1, text.data() + text.size(), code, 16);
    if (text.size() != 7 || result.ec != std::errc() || result.ptr != text.data() + text.size())
      return std::nullopt;
    return Vec3d((code >> 16) & 0xFF, (code >> 8) & 0xFF, code & 0xFF) / 255.0;
  }
  const auto numbers = parse_numbers(text);
  if (!numbers) return std::nullopt;
  if (numbers->size() == 1) return Vec3d((*numbers)[0]);
  if (numbers->size() == 3) return Vec3d((*numbers)[0], (*numbers)[1], (*numbers)[2]);
  return std::nullopt;
}

std::optional<SampledSpectrum> parse_sampled_spectrum(std::string_view text) {
  SampledSpectrum spectrum;
  for (const std::string_view token : split_list(text)) {
    const size_t colon = token.find(':');
    if (colon == std::string_view::npos) return std::nullopt;
    const std::optional<double> wavelength = parse_number(token.substr(0, colon));
    const std::optional<double> value = parse_number(token.substr(colon + 1));
    if (!wavelength || !value || !std::isfinite(*wavelength)) return std::nullopt;
    if (!spectrum.wavelengths.empty() && *wavelength <= spectrum.wavelengths.back()) return std::nullopt;
    spectrum.wavelengths.push_back(*wavelength);
    spectrum.values.push_back(*value);
  }
  if (spectrum.wavelengths.size() < 2) return std::nullopt;
  return spectrum;
}

double srgb_to_linear(double value) {
  return value <= 0.04045 ? value / 12.92 : std::pow((value + 0.055) / 1.055, 2.4);
}

}  // namespace fogbank::scene
