// How records keep light that is spread over directions, and what phase functions make of it.
#include "cache/directional_shape.h"

#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <functional>

#include "core/random.h"
#include "core/sampling.h"

namespace fogbank::cache {
namespace {

/// Mean over the sphere by the midpoint rule in z and azimuth: exact for polynomials along the azimuth, to
/// 1e-5 of the greatest value along z.
double mean_over_sphere(const std::function<double(const Vec3f&)>& function) {
  constexpr int rows = 200;
  constexpr int columns = 48;
  double sum = 0;
  for (int row = 0; row < rows; ++row)
    for (int column = 0; column < columns; ++column) {
      const float z = 2 * (static_cast<float>(row) + 0.5f) / rows - 1;
      const float azimuth = 2 * pi * (static_cast<float>(column) + 0.5f) / columns;
      const float radius = std::sqrt(1 - z * z);
      sum += function({radius * std::cos(azimuth), radius * std::sin(azimuth), z});
    }
  return sum / (rows * columns);
}

/// Moments of a grey light of mean 1.
HarmonicMoments moments_of(const std::function<double(const Vec3f&)>& light) {
  HarmonicMoments moments;
  for (size_t i = 0; i < harmonic_count; ++i) {
    const auto moment = static_cast<float>(mean_over_sphere(
        [&](const Vec3f& w) { return light(w) * static_cast<double>(spherical_harmonics(w)[i]); }));
    if (i < HarmonicMoments::colour_count)
      moments.colour[i] = Vec3f(moment);
    else
      moments.grey[i - HarmonicMoments::colour_count] = moment;
  }
  return moments;
}

/// What `phase` scatters of `light` against a ray: light that comes from w travels along -w, and goes on
/// along -ray.
double scattered(const transport::PhaseFunction& phase, const Vec3f& ray,
                 const std::function<double(const Vec3f&)>& light) {
  return mean_over_sphere([&](const Vec3f& w) {
    return 4 * static_cast<double>(pi) * static_cast<double>(phase.evaluate(-w, -ray)) * light(w);
  });
}

HarmonicMoments random_moments(uint64_t seed, float size) {
  RandomStream random(seed, 0, 0, 0);
  HarmonicMoments moments;
  for (Vec3f& colour : moments.colour)
    for (int c = 0; c < 3; ++c) colour[c] = size * (2 * random.next_float() - 1);
  for (float& grey : moments.grey) grey = size * (2 * random.next_float() - 1);
  return moments;
}

TEST(SphericalHarmonics, AreOrthonormalAndAddUp) {
  for (size_t i = 0; i < harmonic_count; ++i) {
    EXPECT_NEAR(mean_over_sphere([&](const Vec3f& w) { return spherical_harmonics(w)[i]; }), 0, 1e-4);
    for (size_t j = 0; j < harmonic_count; ++j)
      EXPECT_NEAR(mean_over_sphere([&](const Vec3f& w) {
                    const auto harmonics = spherical_harmonics(w);
                    return static_cast<double>(harmonics[i] * harmonics[j]);
                  }),
                  i == j ? 1 : 0, 1e-3)
          << i << ' ' << j;
  }
  RandomStream random(1, 0, 0, 0);
  for (int n = 0; n < 100; ++n) {
    const auto harmonics = spherical_harmonics(square_to_uniform_sphere(random.next_vec2()));
    std::array<float, harmonic_degrees + 1> squares{};
    for (size_t i = 0; i < harmonic_count; ++i)
      squares[static_cast<size_t>(degree_of_harmonic(i))] += sqr(harmonics[i]);
    for (int l = 1; l <= harmonic_degrees; ++l) EXPECT_NEAR(squares[static_cast<size_t>(l)], 2 * l + 1, 1e-4);
  }
}

TEST(DirectionalShape, PhaseFunctionsMakeOfItWhatTheyMakeOfTheLight) {
  // Light of degrees 1 to 3 that is nowhere negative: the closed form is exact but for the rounding of
  // numbers.
  HarmonicMoments moments = random_moments(3, 0.13f);
  for (Vec3f& colour : moments.colour) colour = Vec3f(colour.x);
  const auto light = [&](const Vec3f& w) {
    const auto harmonics = spherical_harmonics(w);
    double sum = 1;
    for (size_t i = 0; i < harmonic_count; ++i)
      sum += static_cast<double>(harmonics[i] * (i < HarmonicMoments::colour_count
                                                     ? moments.colour[i].x
                                                     : moments.grey[i - HarmonicMoments::colour_count]));
    return sum;
  };
  const DirectionalShape shape = DirectionalShape::from_moments(moments);
  RandomStream random(2, 0, 0, 0);
  for (const float g : {-0.6f, -0.3f, 0.0f, 0.3f, 0.6f}) {
    const transport::PhaseFunction phase(g);
    for (int n = 0; n < 10; ++n) {
      const Vec3f ray = square_to_uniform_sphere(random.next_vec2());
      // 15 numbers, each rounded by 0.13 / 127 at most, times harmonics of about 1.7.
      EXPECT_NEAR(ScatteredDirection(phase, ray).share(shape).y, scattered(phase, ray, light), 5e-3) << g;
    }
  }
}

TEST(DirectionalShape, WhatIsLeftOutOfOneHalfOfAllDirectionsIsWithinItsBound) {
  const auto light = [](const Vec3f& w) { return w.z > 0 ? 2.0 : 0.0; };
  const DirectionalShape shape = DirectionalShape::from_moments(moments_of(light));
  for (const float g : {-0.6f, 0.3f, most_mean_cosine}) {
    const transport::PhaseFunction phase(g);
    const auto bound = 11.0 / 16 * std::pow(std::fabs(static_cast<double>(g)), 5);
    for (const float z : {-1.0f, -0.7f, -0.2f, 0.0f, 0.4f, 1.0f}) {
      const Vec3f ray(std::sqrt(1 - z * z), 0, z);
      // Further degrees alternate; rounding and quadrature besides.
      EXPECT_NEAR(ScatteredDirection(phase, ray).share(shape).x, scattered(phase, ray, light), bound + 0.012)
          << g << ' ' << z;
    }
  }
}

TEST(DirectionalShape, NumbersAreRoundedByNoMoreThanA127thOfTheGreatest) {
  for (const float size : {1e-3f, 0.1f, 1.0f, 1.7f}) {
    const HarmonicMoments moments = random_moments(5, size);
    const DirectionalShape shape = DirectionalShape::from_moments(moments);
    EXPECT_TRUE(shape.is_valid());
    const HarmonicMoments kept = shape.moments();
    const float step = 1.001f * size / 127;
    for (size_t i = 0; i < kept.colour.size(); ++i)
      for (int c = 0; c < 3; ++c) EXPECT_NEAR(kept.colour[i][c], moments.colour[i][c], step);
    for (size_t i = 0; i < kept.grey.size(); ++i) EXPECT_NEAR(kept.grey[i], moments.grey[i], step);
    EXPECT_EQ(DirectionalShape::from_moments(kept).moments().colour, kept.colour);
    EXPECT_EQ(DirectionalShape::from_moments(kept), shape);
  }
}

TEST(DirectionalShape, IsNeverNegativeAndEvenLightIsItself) {
  const DirectionalShape beam = DirectionalShape::from_moments(random_moments(7, 5));
  const transport::PhaseFunction phase(0.6f);
  RandomStream random(3, 0, 0, 0);
  for (int n = 0; n < 1000; ++n) {
    const ScatteredDirection direction(phase, square_to_uniform_sphere(random.next_vec2()));
    EXPECT_GE(min_component(direction.share(beam)), 0);
    EXPECT_EQ(direction.share({}), Spectrum(1));
  }
  EXPECT_TRUE(DirectionalShape::from_moments({}).is_even());
  HarmonicMoments broken;
  broken.colour[0] = Vec3f(std::nanf(""), infinity, -infinity);
  EXPECT_TRUE(DirectionalShape::from_moments(broken).is_even());
}

TEST(DirectionalShape, BytesThatAreNoneAreSeen) {
  DirectionalShape shape = DirectionalShape::from_moments(random_moments(9, 1));
  EXPECT_TRUE(shape.is_valid());
  shape.exponent = 5;
  EXPECT_FALSE(shape.is_valid());
  shape.exponent = DirectionalShape::greatest_exponent;
  shape.numbers[4] = -128;
  EXPECT_FALSE(shape.is_valid());
  EXPECT_FALSE((DirectionalShape{.exponent = -9}).is_valid());
}

}  // namespace
}  // namespace fogbank::cache
