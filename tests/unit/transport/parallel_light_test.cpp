// Parallel light that a shadow map guesses at has the mean of light that is sampled without, whatever there
// is to guess wrongly.
#include "transport/parallel_light.h"

#include <gtest/gtest.h>

#include <cmath>
#include <string>

#include "transport/direct_light.h"
#include "transport/world_builders.h"

namespace fogbank::transport {
namespace {

using test::parse_world;

const char* const sun =
    R"(<emitter type="directional"><vector name="direction" value="0.4, -1, 0.2"/>
       <rgb name="irradiance" value="3, 2, 1"/></emitter>)";

/// Fog in a cube of half side 4 with a plate, and `more`.
std::shared_ptr<const World> fog_with(const std::string& more) {
  return parse_world(R"(
  <medium type="homogeneous" id="fog">
    <rgb name="sigma_t" value="0.3, 0.4, 0.6"/><rgb name="albedo" value="0.9, 0.7, 0.8"/>
    <phase type="hg"><float name="g" value="0.4"/></phase>
  </medium>
  <sensor type="perspective"><ref name="medium" id="fog"/></sensor>
  <shape type="cube"><transform name="to_world"><scale value="4"/></transform>
    <bsdf type="null"/><ref name="interior" id="fog"/></shape>
  <shape type="rectangle"><transform name="to_world"><rotate x="1" angle="-90"/><scale value="0.8"/>
    <translate y="0.5"/></transform><bsdf type="twosided"><bsdf type="plastic"/></bsdf></shape>)" +
                     std::string(sun) + more);
}

struct Case {
  std::string name;
  std::string more;
  bool guessed_well;  ///< the light meets nothing but solid surfaces and the boundary
};

class ParallelLight : public testing::TestWithParam<Case> {};

TEST_P(ParallelLight, AgreesWithSingleSamples) {
  const auto world = fog_with(GetParam().more);
  const int32_t medium = world->scene().sensor.medium;
  const uint32_t light = world->lights().parallel_lights().at(0);
  // Cells of 0.04.
  const ShadowMap map(*world, light, medium, 8 * ShadowMap::tile_side);
  RayCounters counters;
  for (const Vec3f& direction : {Vec3f(1, 0, 0), glm::normalize(Vec3f(1, 0.3f, -0.2f))}) {
    const MediumSegment segment{{-3, -0.5f, 0.1f}, direction, 6, &world->medium(medium)};
    Vec3d single(0);
    Vec3d single_squares(0);
    Vec3d guessed(0);
    Vec3d guessed_squares(0);
    constexpr uint32_t pixels = 20000;
    for (uint32_t pixel = 0; pixel < pixels; ++pixel) {
      RandomStream random(1, pixel, 0, 0);
      // Six rays, of lights that are all parallel: more than any guess takes.
      const Vec3d one(in_scattered_radiance(*world, segment, medium, 6, EmissionFoundBy::light_sampling,
                                            random, counters));
      const Vec3d other(in_scattered_parallel_light(*world, light, map, segment, medium, random, counters));
      ASSERT_GE(std::min({other.x, other.y, other.z}), 0.0);
      single += one;
      single_squares += one * one;
      guessed += other;
      guessed_squares += other * other;
    }
    const Vec3d mean = single / static_cast<double>(pixels);
    const Vec3d guessed_mean = guessed / static_cast<double>(pixels);
    const Vec3d variance = single_squares / static_cast<double>(pixels) - mean * mean;
    const Vec3d guessed_variance =
        guessed_squares / static_cast<double>(pixels) - guessed_mean * guessed_mean;
    for (int c = 0; c < 3; ++c) {
      EXPECT_GT(mean[c], 0) << c;
      // 4.5 standard errors, one in 1e5 by chance.
      EXPECT_NEAR(guessed_mean[c], mean[c], 4.5 * std::sqrt((variance[c] + guessed_variance[c]) / pixels))
          << c;
      if (GetParam().guessed_well) {
        EXPECT_LT(guessed_variance[c], 0.3 * variance[c]) << c;
      }
    }
  }
}

INSTANTIATE_TEST_SUITE_P(
    Obstacles, ParallelLight,
    testing::Values(
        Case{"plate", "", true},
        // Some cells know of the wires, most don't.
        Case{
            "wires",
            R"(<shape type="cylinder"><point name="p0" x="-2" y="1" z="-3"/><point name="p1" x="-2" y="1" z="3"/>
                  <float name="radius" value="0.02"/></shape>
                <shape type="cylinder"><point name="p0" x="1.5" y="1" z="-3"/><point name="p1" x="1.6" y="1" z="3"/>
                  <float name="radius" value="0.01"/></shape>)",
            false},
        // Light only through a slit narrower than a cell.
        Case{
            "slit",
            R"(<shape type="rectangle"><transform name="to_world"><rotate x="1" angle="-90"/><scale value="20"/>
                  <translate x="-23.1" y="3"/></transform></shape>
                <shape type="rectangle"><transform name="to_world"><rotate x="1" angle="-90"/><scale value="20"/>
                  <translate x="16.92" y="3"/></transform></shape>)",
            false},
        // A screen that lets half of the light through, above a part of the segment.
        Case{
            "screen",
            R"(<shape type="rectangle"><transform name="to_world"><rotate x="1" angle="-90"/><scale value="1.5"/>
                  <translate x="-1.5" y="2"/></transform>
                  <bsdf type="mask"><float name="opacity" value="0.5"/><bsdf type="diffuse"/></bsdf></shape>)",
            false},
        // A box of clear air that light crosses before it comes back into the fog.
        Case{"clear_air",
             R"(<shape type="cube"><transform name="to_world"><scale value="0.7"/><translate x="1" y="2.5"/>
                  </transform><bsdf type="null"/><ref name="exterior" id="fog"/></shape>)",
             false}),
    [](const auto& named) { return named.param.name; });

TEST(ShadowMap, GuessesByWhatIsAbove) {
  const auto world = fog_with("");
  const int32_t medium = world->scene().sensor.medium;
  const ShadowMap map(*world, world->lights().parallel_lights().at(0), medium, 4 * ShadowMap::tile_side);
  RayCounters counters;
  const auto at = [&](const Vec3f& x) { return map.at(map.line(x, Vec3f(0)).origin, counters); };
  // The light falls by 1 over a way of sqrt(1.2); the plate is at y = 0.5.
  const float way_per_height = std::sqrt(1.2f);
  const ShadowMap::Answer lit = at({0, 2, 0});
  EXPECT_EQ(lit.guess, ShadowMap::Guess::lit);
  // The boundary's height changes by less than half a cell's diagonal over a cell: 0.07 of 9 / 128.
  EXPECT_NEAR(lit.behind_boundary, 2 * way_per_height, 0.1f);
  const ShadowMap::Answer dark = at({0.4f, -0.5f, 0.2f});
  EXPECT_EQ(dark.guess, ShadowMap::Guess::dark);
  EXPECT_EQ(at({0.8f + 0.2f, 0, 0.1f}).guess, ShadowMap::Guess::uncertain);
  EXPECT_EQ(at({0, 0.7f, 0}).guess, ShadowMap::Guess::lit);
  EXPECT_EQ(at({-40, 102, -20}).guess, ShadowMap::Guess::lit);
  EXPECT_EQ(at({100, 0, 0}).guess, ShadowMap::Guess::uncertain);
}

}  // namespace
}  // namespace fogbank::transport
