// How the light that a record holds is spread over directions: what phase functions other than the isotropic
// one need to know of it besides its mean.
#pragma once

#include <array>
#include <cstdint>

#include "core/spherical_harmonics.h"
#include "core/vector.h"
#include "scene/medium.h"
#include "transport/phase_function.h"

namespace fogbank::cache {

/// Henyey-Greenstein phase functions up to this |g| have records. The harmonics of degree l of the light come
/// out of such a phase function times g^l (the addition theorem; Henyey and Greenstein's function is sum (2 l
/// + 1) g^l P_l / 4 pi). What degrees above 3 would add, in units of the mean, is the most for light of one
/// half of all directions: 11/16 |g|^5 = 0.053 at 0.6, 0.0017 at 0.3 (its degree 4 is 0); less for whatever
/// is smoother. Beyond, records would blur what a forward lobe shows.
inline constexpr float most_mean_cosine = scene::most_recorded_mean_cosine;

/// Averages of radiance times spherical_harmonics() over all directions in which one looks, in units of the
/// mean radiance: of each colour channel for degrees 1 and 2, of luminance for degree 3.
struct HarmonicMoments {
  static constexpr size_t colour_count = 8;
  static constexpr size_t grey_count = harmonic_count - colour_count;
  std::array<Vec3f, colour_count> colour{};
  std::array<float, grey_count> grey{};
};

/// HarmonicMoments in 32 bytes: 31 numbers of 7 bits and a sign, times one power of 2. Rounded by 1/127 of
/// the greatest at most.
struct DirectionalShape {
  static constexpr size_t count = 3 * HarmonicMoments::colour_count + HarmonicMoments::grey_count;
  static constexpr int8_t least_exponent = -32;
  static constexpr int8_t greatest_exponent = -5;

  int8_t exponent = 0;  ///< between the two; 0 if all numbers are
  /// Red, green and blue of each harmonic of degrees 1 and 2, and those of degree 3; -127 to 127.
  std::array<int8_t, count> numbers{};

  /// Moments beyond what light that is nowhere negative can have (sqrt(2 l + 1)) are cut.
  static DirectionalShape from_moments(const HarmonicMoments& moments);
  HarmonicMoments moments() const;
  /// Of light that comes from everywhere alike.
  bool is_even() const { return *this == DirectionalShape{}; }
  bool is_valid() const;

  friend bool operator==(const DirectionalShape&, const DirectionalShape&) = default;
};

/// What a phase function makes of each harmonic along one ray.
class ScatteredDirection {
 public:
  /// `direction`: unit, of a ray that meets scattered light: light that arrives from there goes straight on
  /// towards the ray's origin, with the cosine +1 (phase_function.h).
  ScatteredDirection(const transport::PhaseFunction& phase, const Vec3f& direction);

  /// What is scattered against the ray, in units of the mean radiance; >= 0.
  Spectrum share(const DirectionalShape& shape) const;

 private:
  std::array<float, harmonic_count> weights_;
};

}  // namespace fogbank::cache
