// Records of the occlusion-unaware rival: closed forms of a point light, first-order radius, extrapolation.
#include <gtest/gtest.h>

#include <cmath>

#include "cache/extents.h"
#include "cache/index.h"
#include "cache/record_maker.h"
#include "transport/world_builders.h"

namespace fogbank::cache {
namespace {

constexpr float sigma_t = 0.7f;

/// A point light of intensity 3 in boundless fog.
std::shared_ptr<const transport::World> point_light_world() {
  return transport::test::parse_world(R"(
    <medium type="homogeneous" id="fog"><rgb name="sigma_t" value="0.7 0.7 0.7"/><rgb name="albedo" value="0.5"/></medium>
    <sensor type="perspective"><ref id="fog"/></sensor>
    <emitter type="point"><point name="position" x="0" y="0" z="0"/><rgb name="intensity" value="3"/></emitter>
    <shape type="sphere"><point name="center" x="9" y="0" z="0"/><float name="radius" value="1"/></shape>)");
}

Record made(Quantity quantity, const Vec3f& x, const transport::World& world, const RecordMaker& maker) {
  RayCounters counters;
  return maker.make({x, Vec3f(0), {world.medium_at(x), 0, 0, quantity}}, counters);
}

TEST(UnawareRecords, APointLightsDirectRecordIsTheClosedForm) {
  const auto world = point_light_world();
  const auto maker = make_record_maker(Quantity::unaware_direct, world, {.samples = 64});
  const Vec3f x(1.2f, -0.9f, 2.0f);
  const double d = glm::length(Vec3d(x));
  const Record record = made(Quantity::unaware_direct, x, *world, *maker);
  EXPECT_NO_THROW(validate(record));
  const double mean = 3 * std::exp(-static_cast<double>(sigma_t) * d) / (4 * M_PI * d * d);
  const double change = 2 / d + static_cast<double>(sigma_t);
  // Single precision.
  EXPECT_NEAR(static_cast<double>(record.radiance.y), mean, 1e-5 * mean);
  for (int axis = 0; axis < 3; ++axis) {
    const double slope = -mean * change * static_cast<double>(x[axis]) / d;
    EXPECT_NEAR(static_cast<double>(record.gradient[1][axis]), slope, 1e-5 * mean * change);
  }
  // The only sample changes as the sum does.
  EXPECT_NEAR(static_cast<double>(record.proxy), 1 / change, 1e-5 / change);
  EXPECT_LT(static_cast<double>(record.variance), 1e-10 * mean * mean);
  // The sphere of radius 1 around (9, 0, 0).
  EXPECT_TRUE(record.depth.reaches({5.0f, 0.3f, -1.5f}));
  EXPECT_FALSE(record.depth.reaches(2.0f * (Vec3f(9, 0, 0) - x)));
}

TEST(UnawareRecords, TheRestHasNoLightFromEmittersAndChangesLessThanItsSamples) {
  const auto world = point_light_world();
  const auto maker = make_record_maker(Quantity::unaware_rest, world, {.samples = 64, .max_depth = 4});
  const Record record = made(Quantity::unaware_rest, {1.2f, -0.9f, 2.0f}, *world, *maker);
  EXPECT_NO_THROW(validate(record));
  EXPECT_GT(record.radiance.y, 0.0f);
  EXPECT_GT(record.variance, 0.0f);
  const Vec3f gradient = luminance(Spectrum(1)) * record.gradient[1];
  EXPECT_LT(glm::length(gradient) * record.proxy, record.radiance.y);
  const Record again = made(Quantity::unaware_rest, {1.2f, -0.9f, 2.0f}, *world, *maker);
  EXPECT_EQ(again.id, record.id);
  EXPECT_EQ(again.radiance, record.radiance);
}

Record plain_record(Quantity quantity) {
  Record record;
  record.id = 1;
  record.component = {0, 0, 0, quantity};
  record.radiance = Spectrum(2, 0, 1);
  record.gradient = {Vec3f(3, 0, 0), Vec3f(0), Vec3f(0, -4, 0)};
  record.proxy = 0.5f;
  return record;
}

MetricSettings settings() {
  MetricSettings metric;
  metric.threshold = 1e-3;
  metric.radiance_floor = 0.1;
  metric.maximum_radius = 2;
  metric.first_order_change = 0.4;
  return metric;
}

TEST(UnawareRecords, ExtentsAreSpheresOfTheFirstOrderRadius) {
  const RecordSet set({plain_record(Quantity::unaware_direct)});
  const Ellipsoid sphere = base_ellipsoid(settings(), set.place(set.components()[0], 0));
  for (const float a : sphere.semi_axes) EXPECT_FLOAT_EQ(a, 0.2f);
  MetricSettings narrow = settings();
  narrow.maximum_radius = 0.05;
  EXPECT_FLOAT_EQ(base_ellipsoid(narrow, set.place(set.components()[0], 0)).longest(), 0.05f);
  MetricSettings wide = settings();
  wide.minimum_radius = 0.3;
  EXPECT_FLOAT_EQ(guarded_ellipsoids(set, set.components()[0], wide)[0].shortest(), 0.3f);
  MetricSettings wrong = settings();
  wrong.first_order_change = 0;
  EXPECT_THROW(validate(wrong), Error);
}

TEST(UnawareRecords, LookUpsExtrapolateTheLogarithm) {
  const Component component{0, 0, 0, Quantity::unaware_direct};
  const Epoch epoch(std::make_shared<const RecordSet>(std::vector{plain_record(Quantity::unaware_direct)}),
                    settings());
  const Index* index = epoch.find(component);
  ASSERT_NE(index, nullptr);
  const Interpolation found = index->look_up({0.1f, 0.15f, 0});
  // Per channel; black stays black.
  EXPECT_FLOAT_EQ(found.radiance.x, 2 * std::exp(0.15f));
  EXPECT_EQ(found.radiance.y, 0.0f);
  EXPECT_FLOAT_EQ(found.radiance.z, std::exp(-0.6f));
  EXPECT_EQ(extrapolated(Quantity::unaware_rest, 1.0f, 50.0f), 4.0f);
  EXPECT_EQ(extrapolated(Quantity::rest, 1.0f, -3.0f), 0.0f);
}

}  // namespace
}  // namespace fogbank::cache
