// The choice among lights, and distances along segments: probabilities are what happens, and nothing that
// shines is never chosen.
#include "transport/light_sampler.h"

#include <gtest/gtest.h>

#include <cmath>
#include <map>

#include "core/random.h"
#include "core/sampling.h"
#include "support/statistics.h"
#include "transport/distance_table.h"
#include "transport/lights/delta_lights.h"
#include "transport/lights/environment_lights.h"
#include "transport/lights/polygon_lights.h"
#include "transport/lights/round_lights.h"

namespace fogbank::transport {
namespace {

scene::TexturePointer radiance(float value) { return scene::constant_texture(Spectrum(value)); }

std::vector<LightPointer> many_lights(int count, bool with_infinite) {
  RandomStream random(5, 0, 0, 0);
  std::vector<LightPointer> lights;
  if (with_infinite) {
    lights.push_back(std::make_unique<ConstantLight>(Spectrum(0.01f)));
    lights.push_back(std::make_unique<DirectionalLight>(Vec3f(0, -1, 0), Spectrum(0.5f)));
  }
  for (int i = 0; i < count; ++i) {
    const Vec3f p = 8.0f * Vec3f(random.next_float(), random.next_float(), random.next_float()) - 4.0f;
    switch (i % 4) {
      case 0:
        lights.push_back(std::make_unique<PointLight>(p, Spectrum(random.next_float())));
        break;
      case 1:
        lights.push_back(std::make_unique<SphereLight>(p, 0.1f + 0.2f * random.next_float(), false,
                                                       Mat4d(1.0), radiance(random.next_float())));
        break;
      case 2: {
        const Frame frame = Frame::from_normal(square_to_uniform_sphere(random.next_vec2()));
        lights.push_back(std::make_unique<RectangleLight>(p, frame.tangent * 0.5f, frame.bitangent * 0.3f,
                                                          std::array<Vec2f, 3>{},
                                                          radiance(random.next_float())));
        break;
      }
      default:
        lights.push_back(std::make_unique<SpotLight>(p, square_to_uniform_sphere(random.next_vec2()),
                                                     Spectrum(1), 0.5f, 0.3f));
    }
  }
  return lights;
}

MediumInfo fog(const Spectrum& sigma_t, float g = 0) {
  MediumInfo medium;
  medium.sigma_t = sigma_t;
  medium.albedo = Spectrum(0.9f);
  medium.sigma_s = sigma_t * 0.9f;
  medium.mean_sigma_t = mean(sigma_t);
  medium.grey = sigma_t.x == sigma_t.y && sigma_t.y == sigma_t.z;
  medium.phase = PhaseFunction(g);
  return medium;
}

template <typename Place>
void expect_consistent(const LightSampler& sampler, const Place& place, uint32_t seed) {
  std::map<uint32_t, float> stated;
  std::vector<double> observed(sampler.size(), 0);
  RandomStream random(seed, 1, 2, 3);
  constexpr int samples = 40000;
  int chosen = 0;
  for (int i = 0; i < samples; ++i) {
    float u = random.next_float();
    const auto choice = sampler.choose(place, u);
    ASSERT_GE(u, 0);
    ASSERT_LT(u, 1);
    if (!choice) continue;
    ++chosen;
    observed[choice->light] += 1;
    // The same arithmetic both ways: equal up to the order of rounding.
    ASSERT_NEAR(sampler.probability(place, choice->light) / choice->probability, 1, 1e-4);
  }
  std::vector<double> expected(sampler.size(), 0);
  double total = 0;
  for (uint32_t i = 0; i < sampler.size(); ++i) total += expected[i] = sampler.probability(place, i);
  // A bound may promise light that no leaf has; then nothing is chosen. Never more than everything.
  EXPECT_LE(total, 1 + 1e-4);
  EXPECT_NEAR(total, double(chosen) / samples, 0.02);
  for (double& e : expected) e *= chosen / total;
  EXPECT_GT(test::chi_squared_test(observed, expected), test::significance_level(24));
}

TEST(LightSampler, ChoosesWithTheStatedProbability) {
  const MediumInfo medium = fog(Spectrum(0.2f, 0.3f, 0.5f), 0.4f);
  for (const int count : {1, 3, 4, 5, 40, 300}) {
    for (const bool with_infinite : {false, true}) {
      const LightSampler sampler(many_lights(count, with_infinite));
      LightReceiver receiver{Vec3f(0.5f, 0.2f, -0.3f), Vec3f(0), 0.3f};
      expect_consistent(sampler, receiver, 1);
      receiver.normal = Vec3f(0, 1, 0);
      expect_consistent(sampler, receiver, 2);
      const MediumSegment segment{Vec3f(-3, 0, -3), glm::normalize(Vec3f(1, 0.2f, 0.9f)), 7.0f, &medium,
                                  Vec3f(0.5f, 0.3f, 0.2f)};
      expect_consistent(sampler, segment, 3);
    }
  }
}

TEST(LightSampler, EveryLightThatShinesCanBeChosen) {
  const LightSampler sampler(many_lights(300, true));
  const MediumInfo medium = fog(Spectrum(0.3f));
  RandomStream random(9, 0, 0, 0);
  for (int i = 0; i < 300; ++i) {
    const Vec3f x = 10.0f * Vec3f(random.next_float(), random.next_float(), random.next_float()) - 5.0f;
    const Vec3f d = square_to_uniform_sphere(random.next_vec2());
    const LightReceiver in_medium{x, Vec3f(0), 0.3f};
    const LightReceiver on_surface{x, d, 0};
    const MediumSegment segment{x, d, 3, &medium, Vec3f(1.0f / 3)};
    for (uint32_t k = 0; k < sampler.size(); ++k) {
      const Light& light = sampler.light(k);
      const auto sample = light.sample(x, random.next_vec2());
      if (sample && !is_black(sample->radiance)) {
        ASSERT_GT(sampler.probability(in_medium, k), 0);
        if (glm::dot(sample->direction, d) > 1e-3f) {
          ASSERT_GT(sampler.probability(on_surface, k), 0) << k;
        }
      }
      const Vec3f y = x + d * (3 * random.next_float());
      const auto along = light.sample(y, random.next_vec2());
      if (along && !is_black(along->radiance)) {
        ASSERT_GT(sampler.probability(segment, k), 0) << k;
      }
    }
  }
}

TEST(DistanceTable, DensityIntegratesToOneAndIsTheSamples) {
  const std::vector<LightPointer> lights = many_lights(24, true);
  RandomStream random(21, 0, 0, 0);
  int tested = 0;
  for (const float sigma : {1e-3f, 0.3f, 20.0f}) {
    const MediumInfo medium = fog(Spectrum(sigma, 2 * sigma, 0.5f * sigma), 0.6f);
    for (const LightPointer& light : lights) {
      const Vec3f x = 6.0f * Vec3f(random.next_float(), random.next_float(), random.next_float()) - 3.0f;
      const MediumSegment segment{x, square_to_uniform_sphere(random.next_vec2()), 5, &medium,
                                  Vec3f(0.2f, 0.5f, 0.3f)};
      const DistanceTable table(
          segment, *light,
          tested % 2 == 0 ? DistanceTable::Resolution::fine : DistanceTable::Resolution::coarse);
      if (!table.can_contribute()) continue;
      ++tested;
      constexpr int bins = 64;
      constexpr int fine = 64;
      std::vector<double> expected(bins, 0);
      double largest = 0;
      for (int i = 0; i < bins * fine; ++i) {
        const double t = 5 * (i + 0.5) / (bins * fine);
        const double density = table.pdf(static_cast<float>(t));
        expected[static_cast<size_t>(i / fine)] += density * 5 / (bins * fine);
        largest = std::fmax(largest, density);
      }
      double total = 0;
      for (const double e : expected) total += e;
      // The density is piecewise linear; the midpoint rule misses a peak narrower than its step by about step
      // * density.
      EXPECT_NEAR(total, 1, 2e-3 + largest * 5 / (bins * fine));
      std::vector<double> observed(bins, 0);
      constexpr int samples = 20000;
      for (int i = 0; i < samples; ++i) {
        const float t = table.sample(random.next_float());
        ASSERT_GE(t, 0);
        ASSERT_LE(t, 5);
        ASSERT_GT(table.pdf(t), 0);
        observed[static_cast<size_t>(std::min(bins - 1, static_cast<int>(t / 5 * bins)))] += 1;
      }
      if (largest * 5 / (bins * fine) > 1e-3)
        continue;  // too peaked for bins of this width to be integrated exactly
      for (double& e : expected) e *= samples / total;
      EXPECT_GT(test::chi_squared_test(observed, expected), test::significance_level(78)) << sigma;
    }
  }
  EXPECT_GT(tested, 40);
}

TEST(DistanceTable, FollowsTheImportance) {
  // Point light beside a ray in thin fog: the density must be near T_cam / d^2 T_light, whose integral is
  // known by quadrature.
  const MediumInfo medium = fog(Spectrum(0.1f));
  const PointLight light(Vec3f(0.2f, 0, 2), Spectrum(1));
  const MediumSegment segment{Vec3f(0), Vec3f(0, 0, 1), 6, &medium, Vec3f(1.0f / 3)};
  const DistanceTable table(segment, light, DistanceTable::Resolution::fine);
  double integral = 0;
  double relative_variance = 0;
  constexpr int steps = 200000;
  for (int i = 0; i < steps; ++i) {
    const auto t = static_cast<float>(6 * (i + 0.5) / steps);
    float f = 0;
    segment_importance(segment, light, &t, 1, &f);
    const double p = table.pdf(t);
    integral += double(f) * 6 / steps;
    relative_variance += double(f) * f / p * 6 / steps;
  }
  relative_variance = relative_variance / (integral * integral) - 1;
  // The density equals the importance but for interpolation between 16 nodes and the even share of 8 %, which
  // alone can add up to about 0.08.
  EXPECT_LT(relative_variance, 0.1);
}

TEST(MediumSegment, DistancesFollowTheirDensityPerChannel) {
  const MediumInfo medium = fog(Spectrum(0.05f, 0.4f, 3.0f));
  const MediumSegment segment{Vec3f(0), Vec3f(0, 0, 1), 4, &medium, Vec3f(0.3f, 0.6f, 0.1f)};
  RandomStream random(4, 0, 0, 0);
  constexpr int bins = 40;
  constexpr int samples = 100000;
  std::vector<double> observed(bins + 1, 0);
  std::vector<double> expected(bins + 1, 0);
  for (int i = 0; i < samples; ++i) {
    const float u = random.next_float();
    const float t = segment.sample_distance(u, random.next_float());
    observed[static_cast<size_t>(t < 4 ? static_cast<int>(t / 4 * bins) : bins)] += 1;
  }
  for (int i = 0; i < bins * 100; ++i)
    expected[static_cast<size_t>(i / 100)] +=
        segment.scatter_pdf(static_cast<float>(4 * (i + 0.5) / (bins * 100))) * 4 / (bins * 100) * samples;
  expected[bins] = segment.pass_probability() * samples;
  EXPECT_GT(test::chi_squared_test(observed, expected), 0.001);
}

}  // namespace
}  // namespace fogbank::transport
