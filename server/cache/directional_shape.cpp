#include "cache/directional_shape.h"

#include <algorithm>
#include <cmath>

namespace fogbank::cache {

namespace {

constexpr float greatest_number = 127;

float scale_of(int8_t exponent) { return std::ldexp(1.0f, exponent); }

}  // namespace

DirectionalShape DirectionalShape::from_moments(const HarmonicMoments& moments) {
  std::array<float, count> values;
  const auto cut = [](float moment, size_t harmonic) {
    const float most = std::sqrt(static_cast<float>(2 * degree_of_harmonic(harmonic) + 1));
    return std::isfinite(moment) ? std::clamp(moment, -most, most) : 0.0f;
  };
  size_t next = 0;
  for (size_t i = 0; i < HarmonicMoments::colour_count; ++i)
    for (int channel = 0; channel < 3; ++channel) values[next++] = cut(moments.colour[i][channel], i);
  for (size_t i = 0; i < HarmonicMoments::grey_count; ++i)
    values[next++] = cut(moments.grey[i], HarmonicMoments::colour_count + i);
  float greatest = 0;
  for (const float value : values) greatest = std::max(greatest, std::fabs(value));
  DirectionalShape shape;
  // The least power of 2 that makes the greatest fit.
  shape.exponent = greatest_exponent;
  while (shape.exponent > least_exponent && greatest <= greatest_number * scale_of(shape.exponent) / 2)
    --shape.exponent;
  bool even = true;
  for (size_t i = 0; i < count; ++i) {
    shape.numbers[i] = static_cast<int8_t>(std::nearbyint(values[i] / scale_of(shape.exponent)));
    even = even && shape.numbers[i] == 0;
  }
  return even ? DirectionalShape{} : shape;
}

HarmonicMoments DirectionalShape::moments() const {
  const float scale = scale_of(exponent);
  HarmonicMoments result;
  size_t next = 0;
  for (Vec3f& colour : result.colour)
    for (int channel = 0; channel < 3; ++channel)
      colour[channel] = scale * static_cast<float>(numbers[next++]);
  for (float& grey : result.grey) grey = scale * static_cast<float>(numbers[next++]);
  return result;
}

bool DirectionalShape::is_valid() const {
  if (is_even()) return true;
  return exponent >= least_exponent && exponent <= greatest_exponent &&
         std::ranges::all_of(numbers, [](int8_t number) { return number >= -127; }) &&
         std::ranges::any_of(numbers, [](int8_t number) { return number != 0; });
}

ScatteredDirection::ScatteredDirection(const transport::PhaseFunction& phase, const Vec3f& direction)
    : weights_(spherical_harmonics(direction)) {
  const float g = phase.mean_cosine();
  const std::array<float, harmonic_degrees + 1> bands{1, g, g * g, g * g * g};
  for (size_t i = 0; i < harmonic_count; ++i)
    weights_[i] *= bands[static_cast<size_t>(degree_of_harmonic(i))];
}

Spectrum ScatteredDirection::share(const DirectionalShape& shape) const {
  Spectrum colour(0);
  const int8_t* number = shape.numbers.data();
  for (size_t i = 0; i < HarmonicMoments::colour_count; ++i, number += 3)
    colour += weights_[i] * Spectrum(number[0], number[1], number[2]);
  float grey = 0;
  for (size_t i = 0; i < HarmonicMoments::grey_count; ++i)
    grey += weights_[HarmonicMoments::colour_count + i] * static_cast<float>(*number++);
  return glm::max(1.0f + scale_of(shape.exponent) * (colour + grey), Spectrum(0));
}

}  // namespace fogbank::cache
