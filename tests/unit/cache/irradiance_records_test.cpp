// Irradiance records against path tracing, and what every record must keep to.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "cache/record_maker.h"
#include "core/frame.h"
#include "core/sampling.h"
#include "transport/path_tracer.h"
#include "transport/world_builders.h"

namespace fogbank::cache {
namespace {

using transport::test::parse_world;

const std::string fog = R"(<medium type="homogeneous" id="fog"><rgb name="sigma_t" value="0.4, 0.4, 0.6"/>
    <rgb name="albedo" value="0.8, 0.7, 0.6"/></medium>
  <sensor type="perspective"><ref name="medium" id="fog"/></sensor>)";

/// A room of |x|, |y| <= 1, 0 <= z <= 2 with red and grey walls, a light below its ceiling and a block.
const std::string box = R"(
  <shape type="cube"><transform name="to_world"><translate z="1"/></transform>
    <bsdf type="twosided"><bsdf type="diffuse"><rgb name="reflectance" value="0.7, 0.5, 0.4"/></bsdf></bsdf></shape>
  <shape type="rectangle"><transform name="to_world"><scale value="0.4"/><rotate x="1" angle="180"/>
    <translate x="0.2" z="1.9"/></transform>
    <bsdf type="diffuse"><rgb name="reflectance" value="0.3"/></bsdf>
    <emitter type="area"><rgb name="radiance" value="4, 3, 2"/></emitter></shape>
  <shape type="cube"><transform name="to_world"><scale value="0.3"/><rotate z="1" angle="20"/>
    <translate x="-0.3" y="0.2" z="0.3"/></transform>
    <bsdf type="diffuse"><rgb name="reflectance" value="0.6"/></bsdf></shape>)";

Wish wish_at(const Vec3f& position, const Vec3f& normal, int32_t medium) {
  return {position, normal, {medium, 0, 0, Quantity::irradiance}};
}

Record make(const std::shared_ptr<const transport::World>& world, const Wish& wish, int32_t samples,
            uint64_t seed) {
  RayCounters counters;
  return make_record_maker(Quantity::irradiance, world, {.samples = samples, .seed = seed})
      ->make(wish, counters);
}

struct Estimate {
  double mean = 0;
  double variance = 0;  ///< of the mean
};

Estimate estimate_of(const std::vector<double>& samples) {
  Estimate result;
  const auto count = static_cast<double>(samples.size());
  for (const double sample : samples) result.mean += sample / count;
  for (const double sample : samples)
    result.variance += (sample - result.mean) * (sample - result.mean) / (count * (count - 1));
  return result;
}

/// Luminance of irradiance over pi without light straight from emitters, path traced.
Estimate path_traced(const std::shared_ptr<const transport::World>& world, const Wish& wish, int count) {
  const transport::PathTracer kernel(world, {});
  const Frame frame = Frame::from_normal(wish.normal);
  std::vector<double> samples;
  for (int i = 0; i < count; ++i) {
    RandomStream random(99, static_cast<uint32_t>(i), 0, 0);
    RayCounters counters;
    const Vec3f direction = frame.to_world(square_to_cosine_hemisphere(random.next_vec2()));
    scene::Hit hit;
    samples.push_back(static_cast<double>(
        luminance(kernel.arriving_radiance({wish.position + 1e-4f * wish.normal, direction, infinity},
                                           wish.component.medium, 1, random, counters, &hit))));
  }
  return estimate_of(samples);
}

TEST(IrradianceRecords, ValueIsThatOfPathTracing) {
  for (const bool in_fog : {false, true}) {
    const auto world = parse_world((in_fog ? fog : "") + box);
    for (const auto& [position, normal] :
         {std::pair(Vec3f(0.4f, -0.5f, 0), Vec3f(0, 0, 1)), std::pair(Vec3f(-1, 0.3f, 0.9f), Vec3f(1, 0, 0)),
          std::pair(Vec3f(-0.2f, 0.1f, 0.6f), Vec3f(0, 0, 1))}) {
      const Wish wish = wish_at(position, normal, in_fog ? 0 : scene::none);
      std::vector<double> values;
      double claimed = 0;
      constexpr int records = 16;
      for (uint64_t seed = 0; seed < records; ++seed) {
        const Record record = make(world, wish, 144, seed);
        EXPECT_NO_THROW(validate(record));
        values.push_back(static_cast<double>(luminance(record.radiance)));
        claimed += static_cast<double>(record.variance) / records;
      }
      const Estimate cached = estimate_of(values);
      const Estimate truth = path_traced(world, wish, 20000);
      // Six comparisons with fixed seeds; four standard deviations are a chance of 1 in 3000 for all.
      EXPECT_NEAR(cached.mean, truth.mean, 4 * std::sqrt(cached.variance + truth.variance));
      // The variance that records tell is that of their spread: within a factor of 3 for 16 of them, since it
      // counts what differs between strata too.
      EXPECT_GT(claimed, cached.variance * records / 3);
      EXPECT_LT(claimed, cached.variance * records * 5);
    }
  }
}

TEST(IrradianceRecords, FurnaceOfEmittingWalls) {
  // All walls emit 1 and reflect a half: radiance 2 everywhere, of which 1 comes straight from an emitter.
  const auto world = parse_world(R"(<shape type="cube">
      <bsdf type="twosided"><bsdf type="diffuse"><rgb name="reflectance" value="0.5"/></bsdf></bsdf>
      <transform name="to_world"><scale x="-1"/></transform>
      <boolean name="flip_normals" value="true"/>
      <emitter type="area"><rgb name="radiance" value="1"/></emitter></shape>)");
  std::vector<double> values;
  double gradient = 0;
  for (uint64_t seed = 0; seed < 16; ++seed) {
    const Record record = make(world, wish_at({0.3f, 0.2f, -1}, {0, 0, 1}, scene::none), 256, seed);
    values.push_back(static_cast<double>(luminance(record.radiance)));
    gradient += static_cast<double>(glm::length(record.gradient[1])) / 16;
  }
  const Estimate estimate = estimate_of(values);
  EXPECT_NEAR(estimate.mean, 1, 4 * std::sqrt(estimate.variance));
  // What of the gradient is noise is scaled down: 1 over the size of the box would be without.
  EXPECT_LT(gradient, 0.15);
}

TEST(IrradianceRecords, ConstantEnvironmentIsAllDirect) {
  const auto world = parse_world(R"(<emitter type="constant"><rgb name="radiance" value="1"/></emitter>
      <shape type="disk"/>)");
  const Record record = make(world, wish_at({0.1f, 0.2f, 0}, {0, 0, 1}, scene::none), 64, 0);
  EXPECT_EQ(record.radiance, Spectrum(0));
  EXPECT_EQ(record.gradient[0], Vec3f(0));
  EXPECT_NO_THROW(validate(record));
}

TEST(IrradianceRecords, DerivativesLieInTheTangentPlane) {
  const auto world = parse_world(fog + box);
  const Vec3f normal = glm::normalize(Vec3f(0.2f, -0.1f, 1));
  const Record record = make(world, wish_at({0.4f, -0.5f, 0}, normal, 0), 144, 3);
  for (const Vec3f& gradient : record.gradient)
    EXPECT_NEAR(glm::dot(gradient, normal), 0, 1e-5f * glm::length(gradient));
  EXPECT_NEAR(glm::length(record.hessian * normal), 0, 1e-4f * record.hessian.norm());
}

TEST(IrradianceRecords, AreAFunctionOfTheWish) {
  const auto world = parse_world(fog + box);
  const Wish wish = wish_at({0.4f, -0.5f, 0}, {0, 0, 1}, 0);
  const Record first = make(world, wish, 64, 5);
  const Record again = make(world, wish, 64, 5);
  EXPECT_EQ(first.id, again.id);
  EXPECT_EQ(first.radiance, again.radiance);
  EXPECT_EQ(first.gradient, again.gradient);
  EXPECT_EQ(first.hessian.entries, again.hessian.entries);
  EXPECT_EQ(first.depth, again.depth);
  EXPECT_NE(first.id, make(world, wish, 64, 6).id);
  EXPECT_NE(first.id, make(world, wish, 100, 5).id);
  EXPECT_NE(first.id, make(world, wish_at(wish.position, -wish.normal, 0), 64, 5).id);
}

TEST(IrradianceRecords, DepthGuardKnowsTheWallsAround) {
  const auto world = parse_world(box);
  const Record record = make(world, wish_at({0.4f, -0.5f, 0}, {0, 0, 1}, scene::none), 64, 0);
  EXPECT_TRUE(record.depth.reaches({0.4f, 0, 0}));
  EXPECT_FALSE(record.depth.reaches({0.7f, 0, 0}));
  EXPECT_FALSE(record.depth.reaches({0, -0.6f, 0}));
}

}  // namespace
}  // namespace fogbank::cache
