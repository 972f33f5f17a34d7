// The plan: what is on and off in scenes whose needs are known, and that "nothing in between" is never
// claimed where a shadow ray says otherwise.
#include "transport/plan.h"

#include <gtest/gtest.h>

#include <map>
#include <memory>

#include "core/random.h"
#include "core/sampling.h"
#include "transport/world_builders.h"

namespace fogbank::transport {
namespace {

using test::load_world;
using test::parse_world;

std::map<std::string, bool> switches(const Plan& plan) {
  std::map<std::string, bool> on;
  for (const PlanTerm& term : plan.terms()) {
    EXPECT_TRUE(on.emplace(term.term, term.on).second) << term.term << " is listed twice";
    EXPECT_FALSE(term.reason.empty()) << term.term;
  }
  return on;
}

std::string printed(const Plan& plan) {
  std::string text;
  for (const PlanTerm& term : plan.terms())
    text += term.term + (term.on ? ": on, " : ": off, ") + term.reason + "\n";
  return text;
}

std::string fog(const char* sigma_t, const char* albedo) {
  return std::string(R"(<medium type="homogeneous" id="fog"><rgb name="sigma_t" value=")") + sigma_t +
         R"("/><rgb name="albedo" value=")" + albedo +
         R"("/></medium><sensor type="perspective"><ref name="medium" id="fog"/></sensor>)";
}

const std::string black_light = R"(
  <shape type="rectangle" id="lamp"><transform name="to_world"><rotate x="1" angle="180"/><translate z="2"/></transform>
    <bsdf type="diffuse"><rgb name="reflectance" value="0"/></bsdf>
    <emitter type="area"><rgb name="radiance" value="3"/></emitter></shape>)";

TEST(Plan, Penumbra) {
  const auto world = load_world("scenes/penumbra", "penumbra.xml");
  const Plan plan(*world, {});
  SCOPED_TRACE(printed(plan));
  const std::map<std::string, bool> expected{{"in-scattering", true},
                                             {"closed forms", false},
                                             {"light grids", true},
                                             {"environment grid", false},
                                             {"constant environment", false},
                                             {"bisection", true},
                                             {"boundary crossings", true},
                                             {"reflected light", true},
                                             {"mirrors", false},
                                             {"shells", true},
                                             {"sphere grid", true},
                                             {"chromatic transmittance", false}};
  EXPECT_EQ(switches(plan), expected);
  // The plates are below the light, the box of the fog is around both.
  EXPECT_TRUE(plan.may_be_occluded(0, {0, 0, 0.5f}));
  EXPECT_FALSE(plan.may_cross_boundaries(0, {0, 0, 0.5f}));
  EXPECT_TRUE(plan.may_cross_boundaries(0, {0, 0, -5}));
}

TEST(Plan, OpenSpaceWithOneLightNeedsItsGridOnly) {
  const auto world = parse_world(fog("0.3", "0.5") + black_light);
  PlanRequest request;
  request.from_medium = false;
  const Plan plan(*world, request);
  SCOPED_TRACE(printed(plan));
  EXPECT_EQ(plan.treatment(0), LightTreatment::light_grid);
  EXPECT_FALSE(plan.sphere_grid());
  EXPECT_FALSE(plan.may_be_occluded(0, {0, 0, 0}));
  EXPECT_FALSE(plan.may_be_occluded(0, {50, -20, 7}));
  EXPECT_FALSE(switches(plan)["bisection"]);
  request.leave_out = false;
  const Plan all(*world, request);
  EXPECT_TRUE(all.sphere_grid() && all.reflected() && all.mirrors() && all.chromatic());
  EXPECT_TRUE(all.may_be_occluded(0, {0, 0, 0}) && all.may_cross_boundaries(0, {0, 0, 0}));
  EXPECT_FALSE(all.shells()) << "what isn't asked for isn't forced";
}

TEST(Plan, ConvexRoom) {
  const auto world = parse_world(fog("0.3", "0") + black_light + R"(
    <shape type="cube" id="room"><transform name="to_world"><scale x="4" y="4" z="2.01"/></transform></shape>)");
  const Plan plan(*world, {});
  SCOPED_TRACE(printed(plan));
  EXPECT_FALSE(plan.may_be_occluded(0, {3.9f, -3.9f, -1.9f}));
  EXPECT_TRUE(plan.may_be_occluded(0, {0, 0, -2.5f})) << "behind the floor";
  EXPECT_TRUE(switches(plan)["reflected light"]);
  EXPECT_FALSE(switches(plan)["shells"]) << "albedo 0";
  EXPECT_FALSE(switches(plan)["in-scattering"]);
  EXPECT_TRUE(switches(plan)["bisection"]);
}

TEST(Plan, DepthAndOrderSwitchTerms) {
  const auto world = load_world("scenes/penumbra", "penumbra.xml");
  PlanRequest request;
  request.max_depth = 2;
  const Plan direct(*world, request);
  EXPECT_EQ(direct.treatment(0), LightTreatment::light_grid);
  EXPECT_FALSE(direct.sphere_grid());
  request.max_depth = 1;
  EXPECT_EQ(Plan(*world, request).treatment(0), LightTreatment::left_out);
  request = {};
  request.from_surfaces = false;
  const Plan multiple(*world, request);
  EXPECT_EQ(multiple.treatment(0), LightTreatment::left_out);
  EXPECT_TRUE(multiple.shells() && multiple.sphere_grid());
  EXPECT_FALSE(multiple.reflected());
}

TEST(Plan, LightsByKind) {
  const auto world = parse_world(fog("0.1, 0.2, 0.3", "0.5") + R"(
    <emitter type="point"/><emitter type="directional"/><emitter type="constant"/>)" +
                                 black_light + R"(
    <shape type="rectangle"><bsdf type="conductor"/></shape>)");
  const Plan plan(*world, {});
  SCOPED_TRACE(printed(plan));
  std::map<LightTreatment, int> counts;
  for (uint32_t i = 0; i < world->lights().size(); ++i) ++counts[plan.treatment(i)];
  EXPECT_EQ(counts[LightTreatment::closed_form], 2);
  EXPECT_EQ(counts[LightTreatment::sphere_grid], 1);
  EXPECT_EQ(counts[LightTreatment::light_grid], 1);
  EXPECT_TRUE(plan.mirrors() && plan.constant_environment() && plan.chromatic());
}

TEST(Plan, GlowHasACageAroundItsLampAndGreyMedia) {
  const auto world = load_world("scenes/glow", "glow.xml");
  const Plan plan(*world, {});
  SCOPED_TRACE(printed(plan));
  EXPECT_TRUE(plan.may_be_occluded(world->light_of_hit(3, 0), {0, 0, 0}));
  EXPECT_FALSE(plan.chromatic());
}

/// Whatever the plan promises, rays confirm: random boxes, plates and lights of every kind.
TEST(Plan, NothingInBetweenIsNeverClaimedWrongly) {
  RandomStream random(1, 0, 0, 0);
  const auto number = [&random](double low, double high) {
    return std::to_string(low + (high - low) * static_cast<double>(random.next_float()));
  };
  int promises = 0;
  for (int trial = 0; trial < 60; ++trial) {
    std::string body = fog("0.1", "0.5");
    const char* kinds[] = {"rectangle", "disk", "sphere", "cylinder", "cube"};
    for (int i = 0; i < 2; ++i)
      body += std::string("<shape type=\"") + kinds[random.next_uint() % 5] +
              "\"><transform name=\"to_world\"><scale value=\"" + number(0.1, 0.4) +
              "\"/><rotate x=\"1\" y=\"0.3\" angle=\"" + number(0, 360) + "\"/><translate x=\"" +
              number(-1, 1) + "\" y=\"" + number(-1, 1) + "\" z=\"" + number(0, 1) +
              "\"/></transform><emitter type=\"area\"/></shape>";
    const uint32_t plates = random.next_uint() % 3;
    for (uint32_t i = 0; i < plates; ++i)
      body += "<shape type=\"rectangle\"><transform name=\"to_world\"><scale value=\"" + number(0.2, 2) +
              "\"/><rotate y=\"1\" z=\"0.2\" angle=\"" + number(0, 360) + "\"/><translate x=\"" +
              number(-2, 2) + "\" z=\"" + number(-2, 2) + "\"/></transform></shape>";
    if (random.next_uint() % 2 == 0)
      body += "<shape type=\"cube\"><transform name=\"to_world\"><scale value=\"2.5\"/></transform></shape>";
    const auto world = parse_world(body);
    const Plan plan(*world, {});
    RayCounters counters;
    for (int i = 0; i < 200; ++i) {
      const Vec3f x =
          3.0f * (Vec3f(random.next_float(), random.next_float(), random.next_float()) * 2.0f - 1.0f);
      for (uint32_t light = 0; light < world->lights().size(); ++light) {
        if (plan.may_be_occluded(light, x)) continue;
        const auto sample = world->lights().light(light).sample(x, random.next_vec2());
        // At grazing angles a shadow ray can't tell the light from what it lies on.
        if (!sample || sample->distance < 0.05f) continue;
        ++promises;
        EXPECT_FALSE(
            is_black(world->visibility(x, sample->direction, sample->distance, scene::none, counters)))
            << "trial " << trial << " light " << light << " x " << x.x << " " << x.y << " " << x.z << body;
      }
    }
  }
  EXPECT_GT(promises, 1000);
}

}  // namespace
}  // namespace fogbank::transport
