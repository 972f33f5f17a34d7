#include "core/sampling.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <vector>

#include "core/random.h"
#include "support/statistics.h"

namespace fogbank {
namespace {

using test::chi_squared_test;
using test::significance_level;

constexpr int sample_count = 1 << 20;

/// p-value of `warp` having a uniform distribution of (a, b), both in [0, 1), where `coordinates` maps a
/// sample to them: for an area-preserving pair of coordinates that is the whole test of its density.
template <typename Warp, typename Coordinates>
double uniformity(Warp warp, Coordinates coordinates) {
  constexpr std::size_t bins = 32;
  constexpr float scale = bins;
  std::vector<double> observed(bins * bins, 0.0);
  RandomStream random(7, 0, 0, 0);
  for (int i = 0; i < sample_count; ++i) {
    const Vec2f c = coordinates(warp(random.next_vec2()));
    EXPECT_GE(std::min(c.x, c.y), 0.0f);
    const std::size_t column = std::min(bins - 1, static_cast<std::size_t>(c.x * scale));
    const std::size_t row = std::min(bins - 1, static_cast<std::size_t>(c.y * scale));
    observed[row * bins + column] += 1;
  }
  return chi_squared_test(observed, std::vector<double>(bins * bins, double{sample_count} / (bins * bins)));
}

/// Angle of (x, y) in turns, [0, 1].
float turns(float x, float y) {
  const float t = std::atan2(y, x) / (2 * pi);
  return t < 0 ? t + 1 : t;
}

TEST(Sampling, DiskIsUniform) {
  // Area of a disk of radius r is proportional to r^2.
  EXPECT_GT(uniformity(square_to_disk_concentric,
                       [](const Vec2f& p) {
                         return Vec2f{glm::dot(p, p), turns(p.x, p.y)};
                       }),
            significance_level(1));
}

TEST(Sampling, DiskKeepsTheCentreAndTheRim) {
  EXPECT_EQ(square_to_disk_concentric({0.5f, 0.5f}), Vec2f(0));
  for (const Vec2f u : {Vec2f{0, 0}, Vec2f{1, 0}, Vec2f{0, 0.5f}, Vec2f{0.25f, 1}}) {
    EXPECT_NEAR(glm::length(square_to_disk_concentric(u)), 1.0f, 1e-6f);
  }
}

TEST(Sampling, CosineHemisphereHasItsDensity) {
  // With density cos(theta) / pi, sin^2(theta) and phi are uniform.
  EXPECT_GT(uniformity(square_to_cosine_hemisphere,
                       [](const Vec3f& w) {
                         return Vec2f{w.x * w.x + w.y * w.y, turns(w.x, w.y)};
                       }),
            significance_level(1));
}

TEST(Sampling, SphereIsUniform) {
  // Archimedes: z and phi are uniform.
  EXPECT_GT(uniformity(square_to_uniform_sphere,
                       [](const Vec3f& w) {
                         return Vec2f{0.5f * (w.z + 1), turns(w.x, w.y)};
                       }),
            significance_level(1));
}

TEST(Sampling, ConesAreUniformWithinTheirAngle) {
  for (const float one_minus_cos_max : {1e-5f, 1e-2f, 1.0f, 2.0f}) {
    // Measured through the sine, which keeps its digits for narrow cones: 1 - cos = sin^2 / (1 + cos).
    EXPECT_GT(uniformity([&](const Vec2f& u) { return square_to_uniform_cone(u, one_minus_cos_max); },
                         [&](const Vec3f& w) {
                           const float sin_squared = w.x * w.x + w.y * w.y;
                           const float one_minus_cos = w.z > 0 ? sin_squared / (1 + w.z) : 1 - w.z;
                           return Vec2f{one_minus_cos / one_minus_cos_max, turns(w.x, w.y)};
                         }),
              significance_level(4))
        << "1 - cos = " << one_minus_cos_max;
  }
}

TEST(Sampling, TriangleIsUniform) {
  // (1 - b1)^2 and b2 / (1 - b1) are uniform for a uniform point of the triangle b1, b2 >= 0, b1 + b2 <= 1.
  EXPECT_GT(uniformity(square_to_uniform_triangle,
                       [](const Vec2f& b) {
                         const float rest = 1 - b.x;
                         return Vec2f{rest * rest, rest > 0 ? b.y / rest : 0.0f};
                       }),
            significance_level(1));
}

TEST(Sampling, DirectionsHaveUnitLength) {
  // A few roundings of numbers of size 1: 4 units in the last place.
  constexpr float tolerance = 4 * 0x1p-23f;
  RandomStream random(8, 0, 0, 0);
  for (int i = 0; i < 100000; ++i) {
    const Vec2f u = random.next_vec2();
    ASSERT_NEAR(glm::length(square_to_cosine_hemisphere(u)), 1.0f, tolerance);
    ASSERT_NEAR(glm::length(square_to_uniform_sphere(u)), 1.0f, tolerance);
    ASSERT_NEAR(glm::length(square_to_uniform_cone(u, 0.3f)), 1.0f, tolerance);
  }
}

TEST(Sampling, CornersOfTheSquareGiveFiniteSamples) {
  for (const float x : {0.0f, one_minus_epsilon, 1.0f}) {
    for (const float y : {0.0f, one_minus_epsilon, 1.0f}) {
      EXPECT_TRUE(is_finite(square_to_cosine_hemisphere({x, y})));
      EXPECT_TRUE(is_finite(square_to_uniform_sphere({x, y})));
      EXPECT_TRUE(is_finite(square_to_uniform_cone({x, y}, 2.0f)));
      const Vec2f b = square_to_uniform_triangle({x, y});
      EXPECT_GE(std::min(b.x, b.y), 0.0f);
      EXPECT_LE(b.x + b.y, 1.0f);
    }
  }
}

}  // namespace
}  // namespace fogbank
