// Generations of rest records: gathered from the records of the generation before instead of paths.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "cache/record_maker.h"
#include "cache/record_makers/rest.h"
#include "core/sampling.h"
#include "transport/path_tracer.h"
#include "transport/world_builders.h"

namespace fogbank::cache {
namespace {

using transport::test::parse_world;

/// A ball of fog of radius 1 in a sky of radiance 1. With albedo 1 radiance is 1 everywhere, and what comes
/// to the middle without having been scattered is the transmittance, exp(-sigma_t).
std::shared_ptr<const transport::World> ball(const std::string& sigma_t, const std::string& albedo) {
  return parse_world(R"(<medium type="homogeneous" id="fog"><rgb name="sigma_t" value=")" + sigma_t +
                     R"("/><rgb name="albedo" value=")" + albedo + R"("/></medium>
    <sensor type="perspective"><ref name="medium" id="fog"/></sensor>
    <shape type="sphere"><float name="radius" value="1"/><bsdf type="null"/>
      <ref name="interior" id="fog"/></shape>
    <emitter type="constant"><rgb name="radiance" value="1"/></emitter>)");
}

/// A closed room in fog with a lamp and a block.
std::shared_ptr<const transport::World> room() {
  return parse_world(R"(<medium type="homogeneous" id="fog"><rgb name="sigma_t" value="0.5"/>
      <rgb name="albedo" value="0.8"/></medium>
    <sensor type="perspective"><ref name="medium" id="fog"/></sensor>
    <shape type="cube"><boolean name="flip_normals" value="true"/>
      <bsdf type="twosided"><bsdf type="diffuse"><rgb name="reflectance" value="0.6"/></bsdf></bsdf></shape>
    <shape type="cube"><transform name="to_world"><scale value="0.3"/><translate x="0.4" y="-0.2" z="-0.7"/>
      </transform><bsdf type="diffuse"><rgb name="reflectance" value="0.5"/></bsdf></shape>
    <shape type="sphere"><point name="center" x="-0.4" y="0.3" z="0.6"/><float name="radius" value="0.15"/>
      <emitter type="area"><rgb name="radiance" value="10"/></emitter></shape>)");
}

Wish wish_at(const Vec3f& x, uint8_t generation) { return {x, Vec3f(0), {0, 0, generation, Quantity::rest}}; }

/// Points of a grid inside the ball.
std::vector<Vec3f> lattice() {
  std::vector<Vec3f> points;
  constexpr float spacing = 0.4f;
  for (int x = -2; x <= 2; ++x)
    for (int y = -2; y <= 2; ++y)
      for (int z = -2; z <= 2; ++z) {
        const Vec3f p = spacing * Vec3f(x, y, z);
        if (glm::length(p) < 0.95f) points.push_back(p);
      }
  return points;
}

std::unique_ptr<const Epoch> epoch_of(std::vector<Record> records, double radius) {
  MetricSettings metric;
  metric.threshold = 1e-3;
  metric.radiance_floor = 0.01;
  metric.maximum_radius = radius;
  metric.minimum_radius = radius;
  return std::make_unique<const Epoch>(std::make_shared<const RecordSet>(std::move(records)), metric);
}

/// Each point's record, gathered from `sources`.
std::vector<Record> generation_of(const RecordMaker& maker, const std::vector<Vec3f>& points,
                                  uint8_t generation, const Epoch* sources) {
  std::vector<Record> records;
  RayCounters counters;
  for (const Vec3f& x : points) records.push_back(maker.make(wish_at(x, generation), sources, counters));
  return records;
}

Record constant_record(const Vec3f& x, float radiance) {
  Record record;
  record.position = x;
  record.component = wish_at(x, 0).component;
  record.radiance = Spectrum(radiance);
  record.id = content_id(x, record.component, "constant", 0);
  return record;
}

/// Generation 0 says that nothing is scattered. What the generations after it say is the light of one, two,
/// ... scattering events: the error falls by the share of light that is scattered once more, of which
/// the Neumann series of the transport equation says that it is below the albedo.
TEST(Generations, ErrorFallsBelowTheAlbedo) {
  const RestRecordMaker maker(ball("2", "1"), {.samples = 64});
  const double truth = 1 - std::exp(-2.0);
  std::vector<Record> records;
  for (const Vec3f& x : lattice()) records.push_back(constant_record(x, 0));
  const size_t middle = lattice().size() / 2;
  ASSERT_EQ(lattice()[middle], Vec3f(0));
  std::unique_ptr<const Epoch> sources = epoch_of(std::move(records), 0.6);
  double error = truth;
  for (uint8_t generation = 1; generation <= 4; ++generation) {
    records = generation_of(maker, lattice(), generation, sources.get());
    const double next = truth - static_cast<double>(records[middle].radiance.y);
    // Falls by 0.5 to 0.75 each time; noise of a few percent of the value doesn't reach 0.9 of these errors.
    EXPECT_LT(next, 0.9 * error) << int{generation};
    EXPECT_GT(next, 0) << int{generation};
    error = next;
    sources = epoch_of(std::move(records), 0.6);
  }
}

/// Generation 0 closes the tail: with it the next one is right whatever the albedo.
TEST(Generations, PathsCloseTheTail) {
  for (const char* albedo : {"1", "0.9999"}) {
    const std::shared_ptr<const transport::World> world = ball("2", albedo);
    const RestRecordMaker first(world, {.samples = 64});
    const std::unique_ptr<const Epoch> sources = epoch_of(generation_of(first, lattice(), 0, nullptr), 0.45);
    double sum = 0;
    double variance = 0;
    constexpr int seeds = 8;
    for (uint64_t seed = 0; seed < seeds; ++seed) {
      const RestRecordMaker maker(world, {.samples = 64, .seed = seed});
      RayCounters counters;
      const Record record = maker.make(wish_at(Vec3f(0), 1), sources.get(), counters);
      sum += static_cast<double>(record.radiance.y) / seeds;
      variance += static_cast<double>(record.variance) / (seeds * seeds);
    }
    // 0.0001 a few times is less than 0.1 %; the 2 % are for linear extrapolation over extents of nearly a
    // mean free path, of a field that bends by the square of that.
    EXPECT_NEAR(sum, 1 - std::exp(-2.0), 0.02 + 4 * std::sqrt(variance)) << albedo;
  }
}

TEST(Generations, AgreesWithPathTracing) {
  const std::shared_ptr<const transport::World> world = room();
  const RecordMakerSettings settings{.samples = 64};
  const RestRecordMaker maker(world, settings);
  const auto irradiance = make_record_maker(Quantity::irradiance, world, settings);
  const Vec3f x(0.1f, 0.2f, 0.1f);
  RayCounters counters;
  std::vector<Record> records;
  size_t on_surfaces = 0;
  for (const Wish& wish : maker.sources_of(wish_at(x, 1), 128, counters)) {
    const bool surface = wish.component.quantity == Quantity::irradiance;
    on_surfaces += surface ? 1 : 0;
    records.push_back(
        (surface ? *irradiance : static_cast<const RecordMaker&>(maker)).make(wish, nullptr, counters));
  }
  EXPECT_GT(on_surfaces, 0u);
  EXPECT_GT(records.size(), on_surfaces);
  const std::unique_ptr<const Epoch> sources = epoch_of(std::move(records), 0.4);

  constexpr int seeds = 8;
  double mean = 0;
  double variance = 0;
  for (uint64_t seed = 0; seed < seeds; ++seed) {
    const RestRecordMaker other(world, {.samples = 64, .seed = seed});
    RayCounters used;
    const Record record = other.make(wish_at(x, 1), sources.get(), used);
    mean += static_cast<double>(luminance(record.radiance)) / seeds;
    variance += static_cast<double>(record.variance) / (seeds * seeds);
    EXPECT_GT(record.variance, 0);
  }
  const transport::PathTracer kernel(world, {});
  RandomStream random(7, 0, 0, 0);
  constexpr int paths = 20000;
  double sum = 0;
  double squares = 0;
  for (int i = 0; i < paths; ++i) {
    scene::Hit hit;
    const auto sample = static_cast<double>(luminance(kernel.arriving_radiance(
        {x, square_to_uniform_sphere(random.next_vec2()), infinity}, 0, 2, random, counters, &hit)));
    sum += sample / paths;
    squares += sample * sample / paths;
  }
  // Records and reference have the same source records or none: three standard errors of both, and 4 % for
  // the error that some hundred source records of 64 directions have in common.
  EXPECT_NEAR(mean, sum, 4 * std::sqrt(variance + (squares - sum * sum) / paths) + 0.04 * sum);
}

TEST(Generations, ArePureFunctionsOfTheirSources) {
  const std::shared_ptr<const transport::World> world = ball("1", "0.9");
  const RestRecordMaker maker(world, {.samples = 16});
  std::vector<Record> records;
  for (const Vec3f& x : lattice()) records.push_back(constant_record(x, 0.5f));
  std::vector<Record> reversed(records.rbegin(), records.rend());
  std::vector<Record> fewer(records.begin(), records.end() - 1);
  const auto sources = epoch_of(records, 0.6);
  const auto same_set = epoch_of(reversed, 0.6);
  const Vec3f x(0.1f, 0.2f, 0.3f);
  RayCounters counters;
  const Record record = maker.make(wish_at(x, 1), sources.get(), counters);
  const Record again = maker.make(wish_at(x, 1), same_set.get(), counters);
  EXPECT_EQ(record.id, again.id);
  EXPECT_EQ(record.radiance, again.radiance);
  EXPECT_EQ(record.gradient, again.gradient);
  EXPECT_EQ(record.hessian.entries, again.hessian.entries);
  EXPECT_EQ(record.depth, again.depth);
  EXPECT_EQ(record.variance, again.variance);
  validate(record);
  // Other records, or other extents, are another source.
  EXPECT_NE(record.id, maker.make(wish_at(x, 1), epoch_of(fewer, 0.6).get(), counters).id);
  EXPECT_NE(record.id, maker.make(wish_at(x, 1), epoch_of(records, 0.5).get(), counters).id);
  // Generation 0 reads no source.
  EXPECT_EQ(maker.make(wish_at(x, 0), sources.get(), counters).id,
            maker.make(wish_at(x, 0), nullptr, counters).id);
}

TEST(Generations, ShortPathsAreTraced) {
  const std::shared_ptr<const transport::World> world = ball("1", "0.9");
  std::vector<Record> records;
  for (const Vec3f& x : lattice()) records.push_back(constant_record(x, 1000));
  const auto sources = epoch_of(std::move(records), 0.6);
  RayCounters counters;
  const RestRecordMaker maker(world, {.samples = 16, .max_depth = 4});
  EXPECT_TRUE(maker.sources_of(wish_at(Vec3f(0), 1), 16, counters).empty());
  EXPECT_LT(maker.make(wish_at(Vec3f(0), 1), sources.get(), counters).radiance.y, 1);
  // Camera, x, light: two edges hold no light that was scattered before x.
  const RestRecordMaker none(world, {.samples = 16, .max_depth = 2});
  EXPECT_EQ(none.make(wish_at(Vec3f(0), 0), nullptr, counters).radiance.y, 0);
}

}  // namespace
}  // namespace fogbank::cache
