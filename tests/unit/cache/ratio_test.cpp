// Records of ratios: what is lit, what is shadowed, and how far that may be trusted.
#include "cache/record_makers/ratio.h"

#include <gtest/gtest.h>

#include <cmath>

#include "core/error.h"
#include "derivatives/exact_light_visibility.h"
#include "transport/world_builders.h"

namespace fogbank::cache {
namespace {

using transport::test::parse_world;

/// A light of 1 x 1 at z = 2 that looks down, a square plate below it at z = 1, thin fog.
const char* const plate_below_light = R"(
  <medium type="homogeneous" id="fog"><rgb name="sigma_t" value="0.01"/><rgb name="albedo" value="0.5"/></medium>
  <sensor type="perspective"><ref name="medium" id="fog"/></sensor>
  <shape type="rectangle"><transform name="to_world"><rotate x="1" angle="180"/><scale value="0.5"/><translate z="2"/></transform>
    <emitter type="area"><rgb name="radiance" value="3, 2, 1"/></emitter></shape>
  <shape type="rectangle"><transform name="to_world"><scale value="1"/><translate z="1"/></transform></shape>
  <emitter type="point"><point name="position" x="0" y="0" z="9"/><rgb name="intensity" value="1"/></emitter>)";

class RatioTest : public ::testing::Test {
 protected:
  Record record_at(const Vec3f& x) const {
    RayCounters counters;
    const Record record = maker.make({x, Vec3f(0), {0, light(), 0, Quantity::ratio}}, counters);
    validate(record);
    return record;
  }
  uint16_t light() const {
    for (uint32_t i = 0; i < world->lights().size(); ++i)
      if (!world->lights().light(i).is_delta()) return static_cast<uint16_t>(i);
    return 0;
  }

  std::shared_ptr<const transport::World> world = parse_world(plate_below_light);
  RatioRecordMaker maker{world, {.samples = 1024}};
};

TEST_F(RatioTest, OneWhereAllOfTheLightIsSeen) {
  for (const Vec3f& x : {Vec3f(0.3f, 0.2f, 1.4f), Vec3f(3.5f, 0.1f, 1.2f)}) {
    const Record record = record_at(x);
    for (int c = 0; c < 3; ++c) {
      // Of a piece's middle instead of everywhere: sigma_t squared times the size, 1e-4.
      EXPECT_NEAR(record.radiance[c], 1, 1e-3);
      EXPECT_LT(glm::length(record.gradient[static_cast<size_t>(c)]), 1e-2f);
    }
    EXPECT_GT(record.proxy, 0);
  }
}

TEST_F(RatioTest, NothingInUmbraeAndBehindTheLight) {
  for (const Vec3f& x : {Vec3f(0.1f, 0.05f, 0.6f), Vec3f(0.1f, 0.2f, 2.5f)}) {
    const Record record = record_at(x);
    EXPECT_EQ(record.radiance, Spectrum(0));
    for (const Vec3f& gradient : record.gradient) EXPECT_EQ(gradient, Vec3f(0));
    for (const float entry : record.hessian.entries) EXPECT_EQ(entry, 0);
  }
}

TEST_F(RatioTest, MarginsEndBeforeTheShadowsBorder) {
  // The umbra at z = 0.5 ends, in x, on the line from the light's border at 0.5 past the plate's at 1: 1.25.
  // That line has the slope 0.5 / 1, so the distance to it is (1.25 - x) cos(atan 0.5). The lit zone at z =
  // 0.5 begins on the line from -0.5 past 1: 1.75, slope 1.5.
  const float umbra = (1.25f - 0.9f) * std::cos(std::atan(0.5f));
  const Record dark = record_at({0.9f, 0.0f, 0.5f});
  EXPECT_EQ(dark.radiance, Spectrum(0));
  // Rays around the light are a few degrees apart; margins may not be too long.
  EXPECT_LT(dark.visibility_margin, 1.01f * umbra);
  EXPECT_GT(dark.visibility_margin, 0.8f * umbra);
  const float lit = (2.4f - 1.75f) * std::cos(std::atan(1.5f));
  const Record bright = record_at({2.4f, 0.0f, 0.5f});
  EXPECT_NEAR(bright.radiance.x, 1, 1e-3);
  EXPECT_LT(bright.visibility_margin, 1.01f * lit);
  EXPECT_GT(bright.visibility_margin, 0.8f * lit);
}

TEST_F(RatioTest, SurfacesAroundEndItWhereNothingBlocksTheLight) {
  const Record record = record_at({0.3f, 0.2f, 1.4f});
  EXPECT_TRUE(record.depth.reaches({0, 0, -0.1f}));
  EXPECT_FALSE(record.depth.reaches({0, 0, -0.8f}));
}

TEST_F(RatioTest, PenumbraeFollowTheExactShareOfTheLight) {
  const transport::Plan plan(*world, RatioRecordMaker::plan_request());
  const auto proxy = RatioRecordMaker::make_proxy(*world, plan, light(), 0);
  ASSERT_TRUE(proxy.has_value());
  RayCounters counters;
  const auto exact = [&](const Vec3f& x) {
    return derivatives::exact_direct_light(*world, plan, light(), Vec3d(x), 0, {}, counters)[1] /
           proxy->jet(Vec3d(x), 1e-12).channels[1].value;
  };
  const Vec3f x(1.5f, 0.05f, 0.5f);
  const Record record = record_at(x);
  // Outlines are bisected to 1/128 of a cell, 8 cells a side.
  EXPECT_NEAR(static_cast<double>(record.radiance.y), exact(x), 3e-3);
  const float step = 0.02f;
  const double slope = (exact(x + Vec3f(step, 0, 0)) - exact(x - Vec3f(step, 0, 0))) / (2.0 * step);
  EXPECT_GT(slope, 0.5);
  EXPECT_NEAR(static_cast<double>(record.gradient[1].x), slope, 0.05 * slope);
}

TEST_F(RatioTest, SameWishSameBits) {
  const Vec3f x(1.45f, 0.2f, 0.4f);
  const Record a = record_at(x);
  const Record b = record_at(x);
  EXPECT_EQ(a.id, b.id);
  EXPECT_EQ(a.radiance, b.radiance);
  EXPECT_EQ(a.hessian.entries, b.hessian.entries);
  EXPECT_EQ(a.visibility_margin, b.visibility_margin);
  EXPECT_EQ(a.depth, b.depth);
}

TEST_F(RatioTest, LightsWithoutAClosedFormAreRefused) {
  RayCounters counters;
  const auto delta = static_cast<uint16_t>(1 - light());
  EXPECT_THROW(maker.make({Vec3f(0), Vec3f(0), {0, delta, 0, Quantity::ratio}}, counters), Error);
}

}  // namespace
}  // namespace fogbank::cache
