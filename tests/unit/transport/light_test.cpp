// Lights: their samples integrate what area quadrature integrates, their densities are the densities of their
// samples, and their fluence proxies are what they say.
#include "transport/light.h"

#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <functional>
#include <string>
#include <vector>

#include "core/random.h"
#include "core/sampling.h"
#include "transport/lights/delta_lights.h"
#include "transport/lights/environment_lights.h"
#include "transport/lights/polygon_lights.h"
#include "transport/lights/round_lights.h"

namespace fogbank::transport {
namespace {

/// A point of an emitter, for quadrature that shares nothing with the lights' own sampling.
struct SurfacePoint {
  Vec3d position;
  Vec3d normal;
  double area;
};

struct Case {
  std::string name;
  LightPointer light;
  std::vector<SurfacePoint> points;  ///< midpoint rule over the emitting surface
  bool exact_fluence = false;
};

scene::TexturePointer unit_radiance() { return scene::constant_texture(Spectrum(1)); }

constexpr int steps = 400;

Case triangle_case() {
  const std::array<Vec3f, 3> v{Vec3f(-1, 0.2f, 0), Vec3f(1.5f, -0.3f, 0.4f), Vec3f(0.1f, 1.7f, -0.2f)};
  Case result{"triangle",
              std::make_unique<TriangleLight>(v, std::array<Vec2f, 3>{Vec2f(0, 0), Vec2f(1, 0), Vec2f(0, 1)},
                                              unit_radiance()),
              {},
              true};
  const Vec3d e1(v[1] - v[0]);
  const Vec3d e2(v[2] - v[0]);
  const Vec3d cross = glm::cross(e1, e2);
  for (int i = 0; i < steps; ++i) {
    for (int j = 0; j < steps - i; ++j) {
      // Both triangles of a cell of the barycentric lattice, by their centroids.
      for (int half = 0; half < (j + 1 < steps - i ? 2 : 1); ++half) {
        const double offset = half == 0 ? 1.0 / 3 : 2.0 / 3;
        result.points.push_back({Vec3d(v[0]) + e1 * ((i + offset) / steps) + e2 * ((j + offset) / steps),
                                 glm::normalize(cross), 0.5 * glm::length(cross) / (double(steps) * steps)});
      }
    }
  }
  return result;
}

Case rectangle_case() {
  const Vec3f corner(-0.7f, 0.1f, 0.3f);
  const Vec3f ex(1.2f, 0, 0.9f);
  const Vec3f ey = glm::cross(Vec3f(-0.9f, 0.5f, 1.2f), ex) * 0.4f;
  Case result{
      "rectangle",
      std::make_unique<RectangleLight>(
          corner, ex, ey, std::array<Vec2f, 3>{Vec2f(0, 0), Vec2f(1, 0), Vec2f(0, 1)}, unit_radiance()),
      {},
      true};
  const Vec3d cross = glm::cross(Vec3d(ex), Vec3d(ey));
  for (int i = 0; i < steps; ++i) {
    for (int j = 0; j < steps; ++j)
      result.points.push_back(
          {Vec3d(corner) + Vec3d(ex) * ((i + 0.5) / steps) + Vec3d(ey) * ((j + 0.5) / steps),
           glm::normalize(cross), glm::length(cross) / (double(steps) * steps)});
  }
  return result;
}

Case sphere_case(bool inwards) {
  const Vec3f center(0.2f, -0.1f, 0.4f);
  const float radius = inwards ? 4.0f : 0.6f;
  Case result{inwards ? "sphere inwards" : "sphere",
              std::make_unique<SphereLight>(center, radius, inwards, Mat4d(1.0), unit_radiance()),
              {},
              true};
  for (int i = 0; i < steps; ++i) {
    for (int j = 0; j < steps; ++j) {
      const double z = -1 + 2 * (i + 0.5) / steps;
      const double phi = 2 * M_PI * (j + 0.5) / steps;
      const double r = std::sqrt(1 - z * z);
      const Vec3d n(r * std::cos(phi), r * std::sin(phi), z);
      result.points.push_back({Vec3d(center) + double(radius) * n, inwards ? -n : n,
                               4 * M_PI * double(radius) * double(radius) / (double(steps) * steps)});
    }
  }
  return result;
}

Case disk_case(bool flipped) {
  const Vec3f ax(0.9f, 0.1f, 0);
  const Vec3f ay(-0.1f, 0.5f, 0.3f);
  Case result{flipped ? "disk flipped" : "disk",
              std::make_unique<DiskLight>(Vec3f(0.1f), ax, ay, flipped, unit_radiance()),
              {},
              false};
  const Vec3d cross = glm::cross(Vec3d(ax), Vec3d(ay));
  for (int i = 0; i < steps; ++i) {
    for (int j = 0; j < steps; ++j) {
      const double r = std::sqrt((i + 0.5) / steps);
      const double phi = 2 * M_PI * (j + 0.5) / steps;
      result.points.push_back(
          {Vec3d(0.1f) + Vec3d(ax) * (r * std::cos(phi)) + Vec3d(ay) * (r * std::sin(phi)),
           glm::normalize(cross) * (flipped ? -1.0 : 1.0),
           M_PI * glm::length(cross) / (double(steps) * steps)});
    }
  }
  return result;
}

Case cylinder_case(bool inwards) {
  const Vec3f base(0, 0, -1);
  const Vec3f top(0, 0.5f, 1);
  const Vec3f axis = glm::normalize(top - base);
  const float radius = inwards ? 3.0f : 0.3f;
  const Vec3f ax = Vec3f(1, 0, 0) * radius;
  Case result{inwards ? "cylinder inwards" : "cylinder",
              std::make_unique<CylinderLight>(base, top, ax, inwards, false, unit_radiance()),
              {},
              false};
  const Vec3d ay = glm::cross(Vec3d(axis), Vec3d(1, 0, 0));
  for (int i = 0; i < steps; ++i) {
    for (int j = 0; j < steps; ++j) {
      const double phi = 2 * M_PI * (j + 0.5) / steps;
      const Vec3d n = Vec3d(1, 0, 0) * std::cos(phi) + ay * std::sin(phi);
      result.points.push_back(
          {Vec3d(base) + Vec3d(top - base) * ((i + 0.5) / steps) + n * double(radius), inwards ? -n : n,
           2 * M_PI * double(radius) * double(glm::length(top - base)) / (double(steps) * steps)});
    }
  }
  return result;
}

std::vector<Case> area_cases() {
  std::vector<Case> cases;
  cases.push_back(triangle_case());
  cases.push_back(rectangle_case());
  cases.push_back(sphere_case(false));
  cases.push_back(sphere_case(true));
  cases.push_back(disk_case(false));
  cases.push_back(disk_case(true));
  cases.push_back(cylinder_case(false));
  cases.push_back(cylinder_case(true));
  return cases;
}

/// Smooth functions of direction; the first is 1, so the first integral is the solid angle.
std::array<double, 4> moments(const Vec3d& w) {
  return {1, w.x + 2 * w.y * w.z, std::exp(w.z), w.x * w.x - w.y};
}

/// Integral of the moments over the directions in which the emitting surface is seen (no self-occlusion:
/// convex from where it emits, so facing is visible).
std::array<double, 4> quadrature(const Case& test, const Vec3d& x) {
  std::array<double, 4> sum{};
  for (const SurfacePoint& point : test.points) {
    const Vec3d d = point.position - x;
    const double distance_squared = glm::dot(d, d);
    const Vec3d w = d / std::sqrt(distance_squared);
    const double cosine = -glm::dot(w, point.normal);
    if (cosine <= 0) continue;
    const auto m = moments(w);
    for (size_t k = 0; k < 4; ++k) sum[k] += m[k] * cosine * point.area / distance_squared;
  }
  return sum;
}

TEST(AreaLights, SamplesIntegrateWhatAreaQuadratureDoes) {
  const std::vector<Vec3f> places{
      {0.3f, 0.4f, 2.5f}, {-2, 1, 0.7f}, {0.5f, -3, -1}, {1.2f, 0.8f, 1.1f}, {40, 30, 60}};
  constexpr int samples = 100000;
  for (const Case& test : area_cases()) {
    for (uint32_t p = 0; p < places.size(); ++p) {
      const Vec3f& x = places[p];
      if (test.name == "sphere inwards" && glm::length(x) > 3) continue;  // only its inside sees it
      if (test.name == "cylinder inwards" && glm::length(x) > 2.2f) continue;
      const std::array<double, 4> expected = quadrature(test, Vec3d(x));
      RandomStream random(7, p, 0, 0);
      std::array<double, 4> sum{};
      std::array<double, 4> sum_of_squares{};
      for (int i = 0; i < samples; ++i) {
        const auto sample = test.light->sample(x, random.next_vec2());
        if (!sample) continue;
        ASSERT_TRUE(std::isfinite(sample->pdf) && sample->pdf > 0) << test.name;
        ASSERT_NEAR(glm::length(sample->direction), 1, 1e-5) << test.name;
        const auto m = moments(Vec3d(sample->direction));
        for (size_t k = 0; k < 4; ++k) {
          const double value = m[k] / sample->pdf;
          sum[k] += value;
          sum_of_squares[k] += value * value;
        }
      }
      for (size_t k = 0; k < 4; ++k) {
        const double mean = sum[k] / samples;
        const double error = std::sqrt(std::fmax(sum_of_squares[k] / samples - mean * mean, 0.0) / samples);
        // 4.5 standard errors (160 tests: chance of one failure 1e-3), plus the quadrature's own error: 400
        // midpoints an axis are exact to 1e-4 for smooth integrands, to 2e-3 where the surface turns away
        // along the silhouette.
        EXPECT_NEAR(mean, expected[k],
                    4.5 * error + 2e-3 * std::fmax(std::fabs(expected[0]), std::fabs(expected[k])))
            << test.name << " place " << p << " moment " << k;
      }
      const double fluence = test.light->fluence(x);
      if (test.exact_fluence) {
        EXPECT_NEAR(fluence, expected[0], 3e-3 * expected[0] + 1e-6) << test.name << " place " << p;
      } else if (expected[0] > 1e-6) {
        // An importance only: within a factor of five of the truth.
        EXPECT_GT(fluence, 0.2 * expected[0]) << test.name << " place " << p;
        EXPECT_LT(fluence, 5 * expected[0]) << test.name << " place " << p;
      }
    }
  }
}

TEST(AreaLights, PdfOfAHitIsThePdfOfTheSample) {
  for (const Case& test : area_cases()) {
    RandomStream random(3, 0, 0, 0);
    int compared = 0;
    for (int i = 0; i < 2000; ++i) {
      Vec3f x = square_to_uniform_sphere(random.next_vec2()) * (0.8f + 3 * random.next_float());
      if (test.name == "sphere inwards" || test.name == "cylinder inwards") x *= 0.3f;
      const auto sample = test.light->sample(x, random.next_vec2());
      if (!sample) continue;
      scene::SurfaceInteraction hit;
      hit.distance = sample->distance;
      hit.position = x + sample->direction * sample->distance;
      // The nearest quadrature point gives the normal: exact for flat lights, to its spacing for round ones.
      double nearest = 1e30;
      for (const SurfacePoint& point : test.points) {
        const double d = glm::length(point.position - Vec3d(hit.position));
        if (d < nearest) {
          nearest = d;
          hit.geometric_normal = Vec3f(point.normal);
        }
      }
      const float cosine = -glm::dot(hit.geometric_normal, sample->direction);
      if (cosine < 0.2f)
        continue;  // at grazing angles the neighbour's normal changes the density by more than the tolerance
      const float pdf = test.light->pdf(x, sample->direction, &hit);
      // Round lights: the normal is off by half a cell, 2 pi / 800, which at cosine 0.2 is 4 %.
      EXPECT_NEAR(pdf / sample->pdf, 1, 0.05) << test.name;
      if (++compared == 60) break;
    }
    EXPECT_GE(compared, 20) << test.name;
  }
}

TEST(AreaLights, NothingArrivesBehind) {
  const Case rectangle = rectangle_case();
  const Vec3f behind(0.9f * 3, 0, -1.2f * 3);
  const Vec3f front = Vec3f(0.2f, 0.2f, 0.6f) * 2.0f - behind;
  const bool behind_lit = rectangle.light->fluence(behind) > 0;
  const bool front_lit = rectangle.light->fluence(front) > 0;
  EXPECT_NE(behind_lit, front_lit);
  EXPECT_EQ(rectangle.light->sample(behind, {0.4f, 0.6f}).has_value(), behind_lit);
}

TEST(AreaLights, StableFromNearToFar) {
  // A unit square seen from 1e-4 to 1e5: densities stay finite and the solid angle keeps its closed form.
  const RectangleLight light(Vec3f(-0.5f, -0.5f, 0), Vec3f(1, 0, 0), Vec3f(0, 1, 0),
                             {Vec2f(0, 0), Vec2f(1, 0), Vec2f(0, 1)}, unit_radiance());
  for (int exponent = -4; exponent <= 5; ++exponent) {
    const double h = std::pow(10.0, exponent);
    const double expected = 4 * std::atan(0.25 / (h * std::sqrt(0.5 + h * h)));
    EXPECT_NEAR(light.fluence(Vec3f(0, 0, static_cast<float>(h))) / expected, 1, 4e-3)
        << h;  // beyond 8 sizes the small-source form is used, which is off by (size / distance)^2 / 4
    RandomStream random(1, 0, 0, 0);
    for (int i = 0; i < 1000; ++i) {
      const auto sample = light.sample(Vec3f(0, 0, static_cast<float>(h)), random.next_vec2());
      ASSERT_TRUE(sample.has_value());
      ASSERT_TRUE(std::isfinite(sample->pdf) && sample->pdf > 0 && std::isfinite(sample->distance));
      ASSERT_NEAR(1 / (sample->pdf * expected), 1, h < 1 ? 1e-2 : 1e-1) << h;
    }
  }
}

TEST(DeltaLights, FollowInverseSquareAndFalloff) {
  const PointLight point(Vec3f(1, 2, 3), Spectrum(8));
  const auto from_point = point.sample(Vec3f(1, 2, 1), {0, 0});
  ASSERT_TRUE(from_point);
  EXPECT_FLOAT_EQ(from_point->radiance.x, 2);
  EXPECT_FLOAT_EQ(from_point->direction.z, 1);
  EXPECT_FLOAT_EQ(from_point->distance, 2);

  const SpotLight spot(Vec3f(0), Vec3f(0, 0, 1), Spectrum(1), pi / 6, pi / 12);
  const auto at_angle = [&](float angle) {
    return spot.sample(Vec3f(std::sin(angle), 0, std::cos(angle)), {0, 0});
  };
  EXPECT_FLOAT_EQ(at_angle(0)->radiance.x, 1);
  EXPECT_NEAR(at_angle(pi / 8)->radiance.x, 0.5, 1e-5);
  EXPECT_FALSE(at_angle(pi / 5).has_value());

  const DirectionalLight sun(Vec3f(0, -1, 0), Spectrum(3));
  EXPECT_EQ(sun.sample(Vec3f(5), {0, 0})->direction, Vec3f(0, 1, 0));
  EXPECT_EQ(sun.sample(Vec3f(5), {0, 0})->radiance, Spectrum(3));
}

TEST(EnvironmentLight, SamplesByItsDensityAndIntegrates) {
  auto image = std::make_shared<scene::Image>();
  image->width = 16;
  image->height = 9;
  image->channels = 3;
  RandomStream random(11, 0, 0, 0);
  for (int i = 0; i < 16 * 9 * 3; ++i)
    image->data.push_back(random.next_float() < 0.1f ? 20.0f : 0.2f * random.next_float());
  const EnvironmentLight light(image, Mat4d(1.0), 2.0f);
  // Integral of radiance over the sphere by a fine grid, against importance samples.
  Vec3d expected(0);
  constexpr int rows = 1800;
  for (int y = 0; y < rows; ++y) {
    const double theta = M_PI * (y + 0.5) / rows;
    for (int x = 0; x < 2 * rows; ++x) {
      const double phi = M_PI * (x + 0.5) / rows;
      const Vec3f w(static_cast<float>(std::sin(theta) * std::cos(phi)), static_cast<float>(std::cos(theta)),
                    static_cast<float>(std::sin(theta) * std::sin(phi)));
      expected += Vec3d(light.emitted(w, nullptr)) * (std::sin(theta) * (M_PI / rows) * (M_PI / rows));
    }
  }
  Vec3d sum(0);
  Vec3d squares(0);
  double inverse_pdf = 0;
  constexpr int samples = 400000;
  for (int i = 0; i < samples; ++i) {
    const auto sample = light.sample(Vec3f(0), random.next_vec2());
    ASSERT_TRUE(sample);
    // Both ways round the same cell; rounding of the direction may cross into the next one near its border.
    const float pdf = light.pdf(Vec3f(0), sample->direction, nullptr);
    ASSERT_GT(pdf, 0);
    inverse_pdf += std::fabs(pdf / sample->pdf - 1) > 1e-3 ? 1 : 0;
    const Vec3d value = Vec3d(sample->radiance) / double(sample->pdf);
    sum += value;
    squares += value * value;
    if (i % 100 == 0) {
      const Spectrum looked_up = light.emitted(sample->direction, nullptr);
      ASSERT_NEAR(looked_up.x, sample->radiance.x, 2e-3 * (1 + sample->radiance.x));
    }
  }
  EXPECT_LT(inverse_pdf / samples, 1e-3);
  for (int c = 0; c < 3; ++c) {
    const double mean = sum[c] / samples;
    const double error = std::sqrt((squares[c] / samples - mean * mean) / samples);
    EXPECT_NEAR(mean, expected[c], 4 * error + 1e-4 * expected[c]);
  }
}

}  // namespace
}  // namespace fogbank::transport
