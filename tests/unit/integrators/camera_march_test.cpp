#include "integrators/camera_march.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>

#include "cache/record_clouds.h"

namespace fogbank::integrators {
namespace {

transport::MediumInfo medium(const Spectrum& sigma_t, const Spectrum& albedo) {
  transport::MediumInfo info;
  info.sigma_t = sigma_t;
  info.albedo = albedo;
  info.sigma_s = sigma_t * albedo;
  info.mean_sigma_t = mean(sigma_t);
  info.grey = sigma_t.x == sigma_t.y && sigma_t.y == sigma_t.z;
  return info;
}

class BlindTest final : public cache::VisibilityTest {
 public:
  bool reaches(const Vec3f&, const Vec3f&, const Vec3f&) const override { return false; }
};
const BlindTest blind;

TEST(CameraMarch, StepWeightsAgainstQuadrature) {
  for (const double x : {0.0, 1e-7, 1e-3, 0.1, 0.4999, 0.5, 0.5001, 1.0, 5.0, 30.0, 1e4}) {
    // Midpoint rule in u = 1 - exp(-x s) where that is the better variable.
    double near = 0;
    double far = 0;
    constexpr int count = 200000;
    for (int i = 0; i < count; ++i) {
      const double u = (i + 0.5) / count;
      const double s = x > 1e-3 ? -std::log1p(u * std::expm1(-x)) / x : u;
      const double weight = x > 1e-3 ? -std::expm1(-x) / x : std::exp(-x * u);
      near += (1 - s) * weight / count;
      far += s * weight / count;
    }
    const StepWeights weights = step_weights(static_cast<float>(x));
    // As documented, and what the quadrature itself errs by at the singular end of u.
    EXPECT_NEAR(weights.near, near, 2e-5 * near) << x;
    EXPECT_NEAR(weights.far, far, 2e-5 * far + 1e-7) << x;
  }
  EXPECT_LT(step_weights(std::numeric_limits<float>::max()).near, 1e-30f);
}

TEST(CameraMarch, WeightsAddUpToTheAlbedoTimesWhatIsScattered) {
  for (const Spectrum& sigma : {Spectrum(0.3f), Spectrum(0.1f, 1, 20), Spectrum(1e-6f), Spectrum(500)}) {
    const transport::MediumInfo info = medium(sigma, {0.9f, 0.5f, 0.99f});
    for (const float length : {1e-4f, 0.7f, 40.0f, infinity}) {
      for (const float first : {0.0f, 0.3f}) {
        if (!(first < length)) continue;
        const transport::MediumSegment segment{Vec3f(0), {0, 0, 1}, length, &info};
        const CameraMarch march(segment, first, length, nullptr, blind, 0.05f);
        Spectrum sum(0);
        for (const MarchNode& node : march.nodes()) sum += node.weight;
        // Segments end at optical distance 9; the last node's weight is for the hidden channels' rest too.
        const bool hidden = sigma.x * length > 9 || length > 30;
        for (int channel = 0; channel < 3; ++channel) {
          const auto sigma_t = static_cast<double>(sigma[channel]);
          const auto begin = static_cast<double>(first);
          const double expected = static_cast<double>(info.albedo[channel]) * std::exp(-sigma_t * begin) *
                                  -std::expm1(-sigma_t * (static_cast<double>(length) - begin));
          EXPECT_NEAR(sum[channel], expected, 2e-5 * expected + (hidden ? 2e-4 : 0.0))
              << sigma.x << " " << length;
        }
      }
    }
  }
}

TEST(CameraMarch, EndsWithinItsBoundHoweverSmallTheSteps) {
  const transport::MediumInfo info = medium(Spectrum(0.01f), Spectrum(1));
  const transport::MediumSegment segment{Vec3f(1, 2, 3), {1, 0, 0}, 100, &info};
  const CameraMarch march(segment, 0, 100, nullptr, blind, 1e-5f);
  EXPECT_LE(march.nodes().size(), CameraMarch::most_nodes);
  EXPECT_EQ(march.nodes().front().t, 0);
  EXPECT_EQ(march.nodes().back().t, 100);
  for (size_t i = 1; i < march.nodes().size(); ++i) EXPECT_GT(march.nodes()[i].t, march.nodes()[i - 1].t);
}

TEST(CameraMarch, LinearFieldOfRecordsIsIntegratedExactly) {
  // The cloud's records all say 1 + x/2 + y/4 + z/8.
  const auto set =
      std::make_shared<cache::RecordSet>(cache::test::make_cloud(cache::test::Layout::uniform, 4000, 40, 5));
  const cache::Epoch epoch(set, cache::test::cloud_settings());
  const cache::Index* index = epoch.find(set->components()[0].component);
  const transport::MediumInfo info = medium({0.5f, 2, 6}, Spectrum(0.8f));
  const transport::MediumSegment segment{Vec3f(0.2f), glm::normalize(Vec3f(1, 2, 1)), 0.7f, &info};
  const CameraMarch march(segment, 0, 0.7f, index, blind, 0.1f);
  Spectrum sum(0);
  for (const MarchNode& node : march.nodes()) {
    ASSERT_GT(node.found.weight, 0);
    sum += node.weight * node.found.radiance;
  }
  const double start = 1 + 0.2 * 0.875;
  const double slope = static_cast<double>(glm::dot(segment.direction, Vec3f(0.5f, 0.25f, 0.125f)));
  for (int channel = 0; channel < 3; ++channel) {
    const auto sigma = static_cast<double>(info.sigma_t[channel]);
    const double through = std::exp(-sigma * 0.7);
    const double expected = 0.8 * (start * (1 - through) + slope * ((1 - through) / sigma - 0.7 * through));
    EXPECT_NEAR(sum[channel], expected, 1e-5 * expected);
  }
}

TEST(CameraMarch, ShortGapsAreBridgedUnlessASurfaceMakesThem) {
  // Extents have a radius of 1.
  const auto record_at = [](float x, float radiance) {
    cache::Record record;
    record.position = {x, 0, 0};
    record.radiance = Spectrum(radiance);
    record.samples = 1;
    record.id = 1 + static_cast<uint64_t>(10 * x);
    return record;
  };
  cache::Record hidden = record_at(1.25f, 9);
  for (int axis = 0; axis < 3; ++axis)
    for (const float sign : {-1.0f, 1.0f}) {
      Vec3f direction(0);
      direction[axis] = sign;
      hidden.depth.insert(direction, 1e-3f);
    }
  const auto gap_is_known = [&](std::vector<cache::Record> records) {
    const float end = records[1].position.x;
    cache::MetricSettings settings;
    settings.threshold = 1;
    settings.radiance_floor = 1e-3;
    settings.maximum_radius = 1;
    settings.guards.neighbour_clamp = false;
    settings.guards.verify = false;
    const cache::Epoch epoch(std::make_shared<cache::RecordSet>(std::move(records)), settings);
    const transport::MediumInfo info = medium(Spectrum(0.1f), Spectrum(1));
    const transport::MediumSegment segment{Vec3f(0), {1, 0, 0}, end, &info};
    const CameraMarch march(segment, 0, end, epoch.find({}), blind, 0.1f);
    int gap = 0;
    int known = 0;
    for (const MarchNode& node : march.nodes()) {
      if (node.found.weight > 0) continue;
      ++gap;
      known += node.known ? 1 : 0;
      if (!node.known) continue;
      EXPECT_GT(node.radiance.x, 1);
      EXPECT_LT(node.radiance.x, 3);
    }
    EXPECT_GT(gap, 0);
    EXPECT_TRUE(known == 0 || known == gap);
    return known > 0;
  };
  EXPECT_TRUE(gap_is_known({record_at(0, 1), record_at(2.5f, 3)}));
  EXPECT_FALSE(gap_is_known({record_at(0, 1), record_at(4, 3)}));
  EXPECT_FALSE(gap_is_known({record_at(0, 1), record_at(2.5f, 3), hidden}));
}

TEST(CameraMarch, SamplesAroundNodesAreUnbiased) {
  const transport::MediumInfo info = medium({0.3f, 1, 3}, Spectrum(0.7f));
  const transport::MediumSegment segment{Vec3f(0), {0, 0, 1}, infinity, &info};
  const CameraMarch march(segment, 0.1f, infinity, nullptr, blind, 2.0f);
  RandomStream random(1, 0, 0, 0);
  constexpr int samples = 20000;
  for (size_t number = 0; number < march.nodes().size(); ++number) {
    Vec3d sum(0);
    Vec3d squares(0);
    for (int i = 0; i < samples; ++i) {
      const Vec3d weight(march.sample_around(number, random).weight);
      sum += weight;
      squares += weight * weight;
    }
    for (int channel = 0; channel < 3; ++channel) {
      const double mean = sum[channel] / samples;
      const double error = std::sqrt((squares[channel] / samples - mean * mean) / samples);
      // Five standard errors over some 50 numbers. Threads that render flush what is below the least normal
      // float.
      EXPECT_NEAR(mean, march.nodes()[number].weight[channel],
                  5 * error + 1e-6 * mean + static_cast<double>(std::numeric_limits<float>::min()));
    }
  }
}

}  // namespace
}  // namespace fogbank::integrators
