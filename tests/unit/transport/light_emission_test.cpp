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

TEST(EmissionGuide, GoesWhereTrialsWereImportantAndIntegratesToOne) {
  // Only u[1] < 1/8 matters.
  std::vector<EmissionTrial> trials;
  for (uint32_t i = 0; i < 20000; ++i) {
    RandomStream random(1, i, 0, 0);
    EmissionTrial trial;
    for (float& u : trial.point) u = random.next_float();
    trial.importance = trial.point[1] < 0.125f ? 1.0f : 0.0f;
    trials.push_back(trial);
  }
  const EmissionGuide guide(trials);
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
