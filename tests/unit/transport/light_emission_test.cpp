#include "transport/light_emission.h"

#include <gtest/gtest.h>

#include <cmath>

#include "transport/emission_guide.h"
#include "transport/world_builders.h"

namespace fogbank::transport {
namespace {

struct Lamp {
  std::string name;
  std::string xml;
  double power = 0;  ///< W
};
std::ostream& operator<<(std::ostream& out, const Lamp& lamp) { return out << lamp.name; }

constexpr double pi_d = 3.14159265358979323846;
/// Of the sphere around a unit sphere's bounding box, with the margin of LightEmission.
constexpr double disk_area = pi_d * 3 * 1.001 * 1.001;

class LightEmissionPower : public testing::TestWithParam<Lamp> {};

TEST_P(LightEmissionPower, IsWhatLeavesTheLight) {
  const auto world = test::parse_world(GetParam().xml);
  const LightEmission emission(*world);
  constexpr int count = 40000;
  double sum = 0;
  double squares = 0;
  for (int i = 0; i < count; ++i) {
    RandomStream random(0, static_cast<uint32_t>(i), 0, 0);
    EmissionPoint point;
    for (float& u : point) u = random.next_float();
    const std::optional<EmittedRay> ray = emission.sample(point);
    const double flux = ray ? static_cast<double>(ray->flux.x) : 0;
    if (ray) {
      EXPECT_NEAR(glm::length(ray->direction), 1, 1e-5);
    }
    sum += flux;
    squares += flux * flux;
  }
  const double mean = sum / count;
  const double error = std::sqrt(std::max(squares / count - mean * mean, 0.0) / count);
  // Four standard errors; bounds are a little larger than what they hold.
  EXPECT_NEAR(mean, GetParam().power, 4 * error + 1e-4 * GetParam().power);
}

std::string area(const std::string& shape) {
  return shape + R"(<emitter type="area"><rgb name="radiance" value="2"/></emitter></shape>)";
}
const std::string ball = R"(<shape type="sphere"/>)";

INSTANTIATE_TEST_SUITE_P(
    All, LightEmissionPower,
    testing::Values(
        Lamp{"rectangle", area(R"(<shape type="rectangle">)"), pi_d * 4 * 2},
        Lamp{"sphere", area(R"(<shape type="sphere"><float name="radius" value="0.5"/>)"), pi_d* pi_d * 2},
        Lamp{"disk", area(R"(<shape type="disk">)"), pi_d* pi_d * 2},
        Lamp{"cylinder", area(R"(<shape type="cylinder"><float name="radius" value="0.5"/>)"),
             pi_d* pi_d * 2},
        // Six faces, each half of a pair of triangles or a rectangle.
        Lamp{"cube", area(R"(<shape type="cube">)"), pi_d * 24 * 2},
        Lamp{"point", ball + R"(<emitter type="point"><rgb name="intensity" value="3"/></emitter>)",
             4 * pi_d * 3},
        // Full intensity up to the edge of the cone.
        Lamp{"spot", ball + R"(<emitter type="spot"><float name="cutoff_angle" value="60"/>
               <float name="beam_width" value="60"/><rgb name="intensity" value="3"/></emitter>)",
             2 * pi_d * 0.5 * 3},
        Lamp{"directional",
             ball + R"(<emitter type="directional"><rgb name="irradiance" value="3"/></emitter>)",
             3 * disk_area},
        Lamp{"constant", ball + R"(<emitter type="constant"><rgb name="radiance" value="3"/></emitter>)",
             3 * 4 * pi_d* disk_area},
        Lamp{"two",
             R"(<emitter type="point"><rgb name="intensity" value="3"/></emitter>)" +
                 area(R"(<shape type="disk">)"),
             4 * pi_d * 3 + pi_d* pi_d * 2}),
    [](const testing::TestParamInfo<Lamp>& lamp) { return lamp.param.name; });

/// Fog in a small ball above a large plate, off the centre of the scene.
const std::string small_cloud = R"(
  <medium type="homogeneous" id="fog"><rgb name="sigma_t" value="2"/><rgb name="albedo" value="0.9"/></medium>
  <shape type="rectangle"><transform name="to_world"><scale value="4"/></transform></shape>
  <shape type="sphere"><point name="center" x="2" y="1" z="0.5"/><float name="radius" value="0.25"/>
    <bsdf type="null"/><ref name="interior" id="fog"/></shape>)";

/// Flux of the rays that pass a ball's centre closer than `radius`, of the others, and the shares of rays.
struct Aim {
  double flux_to_ball = 0;
  double variance_to_ball = 0;
  double flux_past_it = 0;
  double variance_past_it = 0;
  double share_to_ball = 0;
};

Aim aim_at(const LightEmission& emission, const Vec3f& center, float radius) {
  constexpr int count = 40000;
  Aim aim;
  double squares_to = 0;
  double squares_past = 0;
  for (int i = 0; i < count; ++i) {
    RandomStream random(3, static_cast<uint32_t>(i), 0, 0);
    EmissionPoint point;
    for (float& u : point) u = random.next_float();
    const std::optional<EmittedRay> ray = emission.sample(point);
    if (!ray) continue;
    const Vec3f offset = center - ray->origin;
    const Vec3f across = offset - ray->direction * glm::dot(offset, ray->direction);
    const auto flux = static_cast<double>(ray->flux.x);
    const bool meets = glm::length(across) < radius;
    (meets ? aim.flux_to_ball : aim.flux_past_it) += flux / count;
    (meets ? squares_to : squares_past) += flux * flux / count;
    aim.share_to_ball += (meets ? 1.0 : 0.0) / count;
  }
  aim.variance_to_ball = (squares_to - aim.flux_to_ball * aim.flux_to_ball) / count;
  aim.variance_past_it = (squares_past - aim.flux_past_it * aim.flux_past_it) / count;
  return aim;
}

TEST(LightEmission, AimsTheSkyAtASmallCloudAndKeepsEveryLinesPower) {
  const auto world = test::parse_world(
      small_cloud + R"(<emitter type="constant"><rgb name="radiance" value="3"/></emitter>)");
  const LightEmission emission(*world);
  constexpr double radius = 0.25;
  const Aim aim = aim_at(emission, Vec3f(2, 1, 0.5f), static_cast<float>(radius));
  // A convex body gets radiance times 4 pi times its mean cross-section.
  const double to_ball = 3 * 4 * pi_d * pi_d * radius * radius;
  const double all =
      3 * 4 * pi_d * pi_d * std::pow(1.001 * static_cast<double>(world->scene().bounds.radius), 2);
  // Four standard errors.
  EXPECT_NEAR(aim.flux_to_ball, to_ball, 4 * std::sqrt(aim.variance_to_ball));
  EXPECT_NEAR(aim.flux_past_it, all - to_ball, 4 * std::sqrt(aim.variance_past_it));
  // Of a disk around the scene 0.2 % would. A quarter is aimed; the ball fills a third of the disk around its
  // box.
  EXPECT_GT(aim.share_to_ball, 0.07);
}

TEST(LightEmission, AimsTheSunAtASmallCloud) {
  const auto world = test::parse_world(
      small_cloud + R"(<emitter type="directional"><vector name="direction" value="1, 0, -1"/>
    <rgb name="irradiance" value="3"/></emitter>)");
  const LightEmission emission(*world);
  const Aim aim = aim_at(emission, Vec3f(2, 1, 0.5f), 0.25f);
  EXPECT_NEAR(aim.flux_to_ball, 3 * pi_d * 0.25 * 0.25, 4 * std::sqrt(aim.variance_to_ball));
  EXPECT_GT(aim.share_to_ball, 0.07);
}

/// `count` uniform trials; importance(point, canonical number).
template <typename Importance>
std::vector<EmissionTrial> uniform_trials(uint32_t count, Importance&& importance) {
  std::vector<EmissionTrial> trials;
  for (uint32_t i = 0; i < count; ++i) {
    RandomStream random(1, i, 0, 0);
    EmissionTrial trial;
    for (float& u : trial.point) u = random.next_float();
    trial.importance = importance(trial.point, random.next_float());
    trials.push_back(trial);
  }
  return trials;
}

/// Share of a guide's samples that `counts` says yes to.
template <typename Counts>
double share_of_samples(const EmissionGuide& guide, Counts&& counts) {
  constexpr uint32_t count = 20000;
  uint32_t counted = 0;
  for (uint32_t i = 0; i < count; ++i) {
    RandomStream random(2, i, 0, 0);
    const float u_box = (static_cast<float>(i) + random.next_float()) / static_cast<float>(count);
    const EmissionGuide::Sample sample = guide.sample(std::fmin(u_box, one_minus_epsilon), random);
    counted += counts(sample) ? 1 : 0;
  }
  return static_cast<double>(counted) / count;
}

TEST(EmissionGuide, GoesByMeanSquaresWhereFewPathsMatterMuch) {
  // One path in a hundred matters ten times as much: the same mean square as in the other half.
  const EmissionGuide guide(uniform_trials(40000,
                                           [](const EmissionPoint& point, float u) {
                                             if (point[1] < 0.5f) return 1.0f;
                                             return u < 0.01f ? 10.0f : 0.0f;
                                           }),
                            {});
  // Some 200 paths make the noisy half's square: 7 % of it, 4 % of its root, 2 % of the share; four times
  // that.
  EXPECT_NEAR(share_of_samples(guide, [](const auto& sample) { return sample.point[1] >= 0.5f; }), 0.5, 0.08);
}

TEST(EmissionGuide, UndoesTheDensityThatTrialsWereDrawnWith) {
  // All points matter alike, but nine in ten trials lie in one half: with density 1.8 there, 0.2 in the
  // other.
  std::vector<EmissionTrial> trials = uniform_trials(40000, [](const EmissionPoint&, float) { return 1.0f; });
  for (size_t i = 0; i < trials.size(); ++i) {
    const bool lower = i % 10 != 0;
    trials[i].point[2] = 0.5f * trials[i].point[2] + (lower ? 0.0f : 0.5f);
    trials[i].pdf = lower ? 1.8f : 0.2f;
    trials[i].importance = 1 / trials[i].pdf;
  }
  const EmissionGuide guide(trials, {});
  EXPECT_NEAR(share_of_samples(guide, [](const auto& sample) { return sample.point[2] < 0.5f; }), 0.5, 0.02);
}

TEST(EmissionGuide, LearnsLightsApart) {
  // Of lights at [0, 0.3) and [0.3, 1) the first alone matters: no box reaches over the edge, so all its
  // samples have one density.
  const std::vector<float> edges{0, 0.3f, 1};
  const EmissionGuide guide(
      uniform_trials(20000, [](const EmissionPoint& point, float) { return point[0] < 0.3f ? 1.0f : 0.0f; }),
      edges);
  // All but the second light's uniform share, 0.2 x 0.7, and its prior: 4 trials of 6000, the root of that.
  EXPECT_NEAR(share_of_samples(guide, [](const auto& sample) { return sample.point[0] < 0.3f; }), 0.83, 0.04);
  EXPECT_EQ(share_of_samples(guide,
                             [](const auto& sample) { return (sample.pdf > 1) == (sample.point[0] < 0.3f); }),
            1.0);
}

TEST(EmissionGuide, GoesWhereTrialsWereImportantAndIntegratesToOne) {
  // Only u[1] < 1/8 matters.
  const EmissionGuide guide(uniform_trials(20000, [](const EmissionPoint& point,
                                                     float) { return point[1] < 0.125f ? 1.0f : 0.0f; }),
                            {});
  constexpr uint32_t count = 20000;
  double inside = 0;
  double volume = 0;
  double volume_inside = 0;
  for (uint32_t i = 0; i < count; ++i) {
    RandomStream random(2, i, 0, 0);
    const float u_box = (static_cast<float>(i) + random.next_float()) / static_cast<float>(count);
    const EmissionGuide::Sample sample = guide.sample(std::fmin(u_box, one_minus_epsilon), random);
    ASSERT_GT(sample.pdf, 0);
    volume += 1 / static_cast<double>(sample.pdf) / count;
    if (sample.point[1] < 0.125f) {
      inside += 1.0 / count;
      volume_inside += 1 / static_cast<double>(sample.pdf) / count;
    }
  }
  EXPECT_GT(inside, 0.7);  // all but the uniform share, the prior and noise
  // Weights are at most 5: the standard deviation is below 5 / sqrt(count).
  EXPECT_NEAR(volume, 1, 4 * 5 / std::sqrt(count));
  EXPECT_NEAR(volume_inside, 0.125, 4 * 5 / std::sqrt(count));
}

}  // namespace
}  // namespace fogbank::transport
