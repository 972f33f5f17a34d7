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

/// CIE 1931 colour matching functions of the 2 degree observer (ISO 11664-1), 360 to 830 nm in steps of 5 nm;
/// linear in between.
constexpr double colour_matching_functions[][3] = {{0.0001299, 3.917e-06, 0.0006061},
                                                   {0.0002321, 6.965e-06, 0.001086},
                                                   {0.0004149, 1.239e-05, 0.001946},
                                                   {0.0007416, 2.202e-05, 0.003486},
                                                   {0.001368, 3.9e-05, 0.00645},
                                                   {0.002236, 6.4e-05, 0.01055},
                                                   {0.004243, 0.00012, 0.02005},
                                                   {0.00765, 0.000217, 0.03621},
                                                   {0.01431, 0.000396, 0.06785},
                                                   {0.02319, 0.00064, 0.1102},
                                                   {0.04351, 0.00121, 0.2074},
                                                   {0.07763, 0.00218, 0.3713},
                                                   {0.13438, 0.004, 0.6456},
                                                   {0.21477, 0.0073, 1.0390501},
                                                   {0.2839, 0.0116, 1.3856},
                                                   {0.3285, 0.01684, 1.62296},
                                                   {0.34828, 0.023, 1.7470599},
                                                   {0.34806, 0.0298, 1.7826},
                                                   {0.3362, 0.038, 1.77211},
                                                   {0.3187, 0.048, 1.7441},
                                                   {0.2908, 0.06, 1.6691999},
                                                   {0.2511, 0.0739, 1.5281},
                                                   {0.19536, 0.09098, 1.28764},
                                                   {0.1421, 0.1126, 1.0419},
                                                   {0.09564, 0.13902, 0.8129501},
                                                   {0.05795, 0.1693, 0.6162},
                                                   {0.03201, 0.20802, 0.46518},
                                                   {0.0147, 0.2586, 0.3533},
                                                   {0.0049, 0.323, 0.272},
                                                   {0.0024, 0.4073, 0.2123},
                                                   {0.0093, 0.503, 0.1582},
                                                   {0.0291, 0.6082, 0.1117},
                                                   {0.06327, 0.71, 0.07825},
                                                   {0.1096, 0.7932, 0.05725},
                                                   {0.1655, 0.862, 0.04216},
                                                   {0.2257499, 0.9148501, 0.02984},
                                                   {0.2904, 0.954, 0.0203},
                                                   {0.3597, 0.9803, 0.0134},
                                                   {0.4334499, 0.9949501, 0.00875},
                                                   {0.5120501, 1, 0.00575},
                                                   {0.5945, 0.995, 0.0039},
                                                   {0.6784, 0.9786, 0.00275},
                                                   {0.7621, 0.952, 0.0021},
                                                   {0.8425, 0.9154, 0.0018},
                                                   {0.9163, 0.87, 0.00165},
                                                   {0.9786, 0.8163, 0.0014},
                                                   {1.0263, 0.757, 0.0011},
                                                   {1.0567, 0.6949, 0.001},
                                                   {1.0622, 0.631, 0.0008},
                                                   {1.0456001, 0.5668, 0.0006},
                                                   {1.0026, 0.503, 0.00034},
                                                   {0.9384, 0.4412, 0.00024},
                                                   {0.8544499, 0.381, 0.00019},
                                                   {0.7514, 0.321, 0.0001},
                                                   {0.6424, 0.265, 4.999999e-05},
                                                   {0.5419, 0.217, 3e-05},
                                                   {0.4479, 0.175, 2e-05},
                                                   {0.3608, 0.1382, 1e-05},
                                                   {0.2835, 0.107, 0},
                                                   {0.2187, 0.0816, 0},
                                                   {0.1649, 0.061, 0},
                                                   {0.1212, 0.04458, 0},
                                                   {0.0874, 0.032, 0},
                                                   {0.0636, 0.0232, 0},
                                                   {0.04677, 0.017, 0},
                                                   {0.0329, 0.01192, 0},
                                                   {0.0227, 0.00821, 0},
                                                   {0.01584, 0.005723, 0},
                                                   {0.0113592, 0.004102, 0},
                                                   {0.0081109, 0.002929, 0},
                                                   {0.0057903, 0.002091, 0},
                                                   {0.0041095, 0.001484, 0},
                                                   {0.0028993, 0.001047, 0},
                                                   {0.0020492, 0.00074, 0},
                                                   {0.00144, 0.00052, 0},
                                                   {0.0009999, 0.0003611, 0},
                                                   {0.0006901, 0.0002492, 0},
                                                   {0.000476, 0.0001719, 0},
                                                   {0.0003323, 0.00012, 0},
                                                   {0.0002348, 8.48e-05, 0},
                                                   {0.0001662, 6e-05, 0},
                                                   {0.0001174, 4.24e-05, 0},
                                                   {8.307527e-05, 3e-05, 0},
                                                   {5.870652e-05, 2.12e-05, 0},
                                                   {4.150994e-05, 1.499e-05, 0},
                                                   {2.935326e-05, 1.06e-05, 0},
                                                   {2.067383e-05, 7.4657e-06, 0},
                                                   {1.455977e-05, 5.2578e-06, 0},
                                                   {1.025398e-05, 3.7029e-06, 0},
                                                   {7.221456e-06, 2.6078e-06, 0},
                                                   {5.085868e-06, 1.8366e-06, 0},
                                                   {3.581652e-06, 1.2934e-06, 0},
                                                   {2.522525e-06, 9.1093e-07, 0},
                                                   {1.776509e-06, 6.4153e-07, 0},
                                                   {1.251141e-06, 4.5181e-07, 0}};
static_assert(std::size(colour_matching_functions) == 95);

Vec3d colour_matching(double wavelength) {
  const double position = (wavelength - shortest_wavelength) / 5;
  const auto i = std::min<size_t>(static_cast<size_t>(position), std::size(colour_matching_functions) - 2);
  const double t = position - static_cast<double>(i);
  const double(&below)[3] = colour_matching_functions[i];
  const double(&above)[3] = colour_matching_functions[i + 1];
  return (1 - t) * Vec3d(below[0], below[1], below[2]) + t * Vec3d(above[0], above[1], above[2]);
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
  // Each function is divided by its own integral, so that an equal-energy spectrum is (1, 1, 1)
  // exactly.
  const Vec3d white = integrate([](double) { return 1.0; });
  const Vec3d xyz = integrate([&](double wavelength) { return evaluate(spectrum, wavelength); }) / white;
  return Spectrum(glm::max(xyz_to_srgb(xyz), Vec3d(0)));
}

Spectrum reflectance_to_srgb(const SampledSpectrum& spectrum) {
  // The same for a flat spectrum here, in sRGB: its three channels would else differ by rounding of the
  // tables.
  const Vec3d white = xyz_to_srgb(integrate(d65));
  const Vec3d colour = xyz_to_srgb(
      integrate([&](double wavelength) { return d65(wavelength) * evaluate(spectrum, wavelength); }));
  const double largest = *std::max_element(spectrum.values.begin(), spectrum.values.end());
  return Spectrum(glm::clamp(colour / white, Vec3d(0), Vec3d(std::max(largest, 1.0))));
}

Spectrum equal_energy_white() { return Spectrum(xyz_to_srgb(Vec3d(1))); }

}  // namespace fogbank::scene
