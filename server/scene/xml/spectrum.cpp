#include "scene/xml/spectrum.h"

#include <algorithm>
#include <cmath>

namespace fogbank::scene {
namespace {

constexpr double shortest_wavelength = 360;  // nm; the range that Mitsuba integrates over
constexpr double longest_wavelength = 830;
constexpr int steps = 940;  // of half a nanometre

/// CIE standard illuminant D65 (ISO 11664-2), 360 to 830 nm in steps of 10 nm; linear in between, as CIE 15
/// says.
constexpr double illuminant_d65[] = {46.6383, 52.0891, 49.9755, 54.6482, 82.7549, 91.4860, 93.4318, 86.6823,
                                     104.865, 117.008, 117.812, 114.861, 115.923, 108.811, 109.354, 107.802,
                                     104.790, 107.689, 104.405, 104.046, 100.000, 96.3342, 95.7880, 88.6856,
                                     90.0062, 89.5991, 87.6987, 83.2886, 83.6992, 80.0268, 80.2146, 82.2778,
                                     78.2842, 69.7213, 71.6091, 74.3490, 61.6040, 69.8856, 75.0870, 63.5927,
                                     46.4182, 66.8054, 63.3828, 64.3040, 59.4519, 51.9590, 57.4406, 60.3125};
static_assert(std::size(illuminant_d65) == 48);

double d65(double wavelength) {
  const double position = (wavelength - shortest_wavelength) / 10;
  const auto i = std::min<size_t>(static_cast<size_t>(position), std::size(illuminant_d65) - 2);
  const double t = position - static_cast<double>(i);
  return (1 - t) * illuminant_d65[i] + t * illuminant_d65[i + 1];
}

/// Gaussian with another width on either side.
double lobe(double wavelength, double mean, double width_below, double width_above) {
  const double t = (wavelength - mean) / (wavelength < mean ? width_below : width_above);
  return std::exp(-0.5 * t * t);
}

/// CIE 1931 colour matching functions by the multi-lobe fit of Wyman, Sloan and Shirley 2013, "Simple
/// Analytic Approximations to the CIE XYZ Color Matching Functions", JCGT 2(2), table 1 (error below 1 % of
/// the peaks).
Vec3d colour_matching(double wavelength) {
  return {1.056 * lobe(wavelength, 599.8, 37.9, 31.0) + 0.362 * lobe(wavelength, 442.0, 16.0, 26.7) -
              0.065 * lobe(wavelength, 501.1, 20.4, 26.2),
          0.821 * lobe(wavelength, 568.8, 46.9, 40.5) + 0.286 * lobe(wavelength, 530.9, 16.3, 31.1),
          1.217 * lobe(wavelength, 437.0, 11.8, 36.0) + 0.681 * lobe(wavelength, 459.0, 26.0, 13.8)};
}

/// IEC 61966-2-1.
Vec3d xyz_to_srgb(const Vec3d& xyz) {
  return {3.240479 * xyz.x - 1.537150 * xyz.y - 0.498535 * xyz.z,
          -0.969256 * xyz.x + 1.875991 * xyz.y + 0.041556 * xyz.z,
          0.055648 * xyz.x - 0.204043 * xyz.y + 1.057311 * xyz.z};
}

double evaluate(const SampledSpectrum& spectrum, double wavelength) {
  const auto& wavelengths = spectrum.wavelengths;
  if (wavelength < wavelengths.front() || wavelength > wavelengths.back()) return 0;
  const auto above = std::upper_bound(wavelengths.begin(), wavelengths.end(), wavelength);
  const auto i = std::min(static_cast<size_t>(above - wavelengths.begin()), wavelengths.size() - 1);
  const double t = (wavelength - wavelengths[i - 1]) / (wavelengths[i] - wavelengths[i - 1]);
  return (1 - t) * spectrum.values[i - 1] + t * spectrum.values[i];
}

/// Integral of weight(wavelength) times the colour matching functions.
template <typename Weight>
Vec3d integrate(const Weight& weight) {
  constexpr double width = (longest_wavelength - shortest_wavelength) / steps;
  Vec3d sum(0);
  for (int i = 0; i < steps; ++i) {
    const double wavelength = shortest_wavelength + (i + 0.5) * width;
    sum += weight(wavelength) * colour_matching(wavelength) * width;
  }
  return sum;
}

}  // namespace

Spectrum emission_to_srgb(const SampledSpectrum& spectrum) {
  // Each fitted function is divided by its own integral, so that an equal-energy spectrum is (1, 1, 1)
  // exactly.
  const Vec3d white = integrate([](double) { return 1.0; });
  const Vec3d xyz = integrate([&](double wavelength) { return evaluate(spectrum, wavelength); }) / white;
  return Spectrum(glm::max(xyz_to_srgb(xyz), Vec3d(0)));
}

Spectrum reflectance_to_srgb(const SampledSpectrum& spectrum) {
  // The same for a flat spectrum here, in sRGB: its three channels would else differ by the fit's error.
  const Vec3d white = xyz_to_srgb(integrate(d65));
  const Vec3d colour = xyz_to_srgb(
      integrate([&](double wavelength) { return d65(wavelength) * evaluate(spectrum, wavelength); }));
  const double largest = *std::max_element(spectrum.values.begin(), spectrum.values.end());
  return Spectrum(glm::clamp(colour / white, Vec3d(0), Vec3d(std::max(largest, 1.0))));
}

Spectrum equal_energy_white() { return Spectrum(xyz_to_srgb(Vec3d(1))); }

}  // namespace fogbank::scene
