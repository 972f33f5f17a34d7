// The techniques of single scattering agree, cached up to its records; which one is taken, and why.
#include "integrators/single_scattering.h"

#include <gtest/gtest.h>

#include <cmath>

#include "cache/record_makers/ratio.h"
#include "integrators/picture.h"
#include "transport/world_builders.h"

namespace fogbank::integrators {
namespace {

using transport::test::parse_world;

/// A plate shadows half of an area light; a point light besides.
const char* const scene_text = R"(
  <medium type="homogeneous" id="fog"><rgb name="sigma_t" value="0.1, 0.15, 0.2"/><rgb name="albedo" value="0.8"/></medium>
  <sensor type="perspective"><ref name="medium" id="fog"/></sensor>
  <shape type="rectangle" id="lamp"><transform name="to_world"><rotate x="1" angle="180"/><scale value="0.5"/><translate z="2"/></transform>
    <emitter type="area"><rgb name="radiance" value="8, 6, 4"/></emitter></shape>
  <shape type="rectangle"><transform name="to_world"><scale value="0.6"/><translate x="-0.6" z="1"/></transform></shape>
  <emitter type="point"><point name="position" x="0" y="2" z="0"/><rgb name="intensity" value="0.5"/></emitter>)";

struct Mean {
  Vec3d sum{0};
  Vec3d squares{0};
  double count = 0;

  void add(const Spectrum& sample) {
    sum += Vec3d(sample);
    squares += Vec3d(sample) * Vec3d(sample);
    ++count;
  }
  Vec3d mean() const { return sum / count; }
  Vec3d variance() const { return (squares / count - mean() * mean()) / count; }
};

class SingleScatteringTest : public ::testing::Test {
 protected:
  SingleScatteringTest() {
    const cache::RatioRecordMaker maker(world, {.samples = 1024});
    std::vector<cache::Record> made;
    RayCounters counters;
    for (int i = 0; i < 60; ++i)
      made.push_back(maker.make({segment.origin + segment.direction * (0.05f + 0.1f * static_cast<float>(i)),
                                 Vec3f(0),
                                 {medium, light, 0, cache::Quantity::ratio}},
                                counters));
    records = std::make_shared<const cache::RecordSet>(std::move(made));
    cache::MetricSettings metric;
    metric.threshold = 1e-3;
    metric.radiance_floor = 0.01;
    metric.direct_floor = 0.01;
    metric.maximum_radius = 1;
    metric.minimum_radius = 0.08;
    epoch = std::make_shared<const cache::Epoch>(records, metric);
  }

  std::pair<Mean, uint64_t> render(SingleScattering technique, uint32_t pixels, bool seen = true) const {
    SingleScatteringTerm term(world);
    term.decide({.single_scattering = technique}, camera, ratio_places(*records));
    EXPECT_EQ(term.looks_up(), technique == SingleScattering::cached);
    Mean mean;
    RayCounters counters;
    for (uint32_t pixel = 0; pixel < pixels; ++pixel) {
      RandomStream random(4, pixel, 0, 0);
      const PixelSample sample = term.sample(segment, medium, {.seen = seen}, epoch.get(), random, counters);
      for (int c = 0; c < 3; ++c) {
        EXPECT_GE(sample.sampled[c], 0);
        EXPECT_GE(sample.cached[c], 0);
      }
      mean.add(sample.sampled + sample.cached);
    }
    return {mean, counters.any_hit};
  }

  std::shared_ptr<const transport::World> world = parse_world(scene_text);
  uint16_t light = world->lights().light(0).is_delta() ? 1 : 0;
  test::TestCamera camera{world->scene().sensor, 64, 64};
  std::shared_ptr<const cache::RecordSet> records;
  int32_t medium = world->scene().sensor.medium;
  transport::MediumSegment segment{{-3, 0.1f, 0.4f}, {1, 0, 0}, 6, &world->medium(medium)};
  std::shared_ptr<const cache::Epoch> epoch;
};

TEST_F(SingleScatteringTest, CachedTakesNoRaysForTheLightAndErrsByItsRecords) {
  const auto [direct, direct_rays] = render(SingleScattering::direct, 20000);
  const auto [cached, cached_rays] = render(SingleScattering::cached, 4000);
  for (int c = 0; c < 3; ++c) {
    // Records every 0.1 units, penumbrae 0.6 wide: ratios err by (0.1 / 0.6)^2 / 8, 0.4 %.
    EXPECT_NEAR(cached.mean()[c], direct.mean()[c],
                0.01 * direct.mean()[c] + 4.5 * std::sqrt(direct.variance()[c] + cached.variance()[c]))
        << c;
    EXPECT_LT(cached.variance()[c] * cached.count, direct.variance()[c] * direct.count) << c;
  }
  EXPECT_LT(static_cast<double>(cached_rays) / cached.count,
            0.7 * static_cast<double>(direct_rays) / direct.count);
}

TEST_F(SingleScatteringTest, SegmentsThatPathsMeetHaveTheSameLightForFewerRays) {
  const auto [seen, rays] = render(SingleScattering::direct, 20000);
  const auto [met, fewer_rays] = render(SingleScattering::direct, 60000, false);
  for (int c = 0; c < 3; ++c)
    EXPECT_NEAR(met.mean()[c], seen.mean()[c], 4.5 * std::sqrt(seen.variance()[c] + met.variance()[c])) << c;
  EXPECT_LT(static_cast<double>(fewer_rays) / met.count, 0.5 * static_cast<double>(rays) / seen.count);
}

TEST_F(SingleScatteringTest, AsksForPlacesThatNoRecordReaches) {
  struct Places final : LookUpObserver {
    void look_up(const LookUp& look_up) override {
      EXPECT_EQ(look_up.place.component.quantity, cache::Quantity::ratio);
      (look_up.found.weight > 0 ? covered : uncovered) += 1;
    }
    int covered = 0;
    int uncovered = 0;
  };
  SingleScatteringTerm term(world);
  term.decide({.single_scattering = SingleScattering::cached}, camera, ratio_places(*records));
  Places without;
  term.observe(segment, medium, nullptr, Spectrum(1), without);
  EXPECT_EQ(without.covered, 0);
  EXPECT_GT(without.uncovered, 8);
  Places with;
  term.observe(segment, medium, epoch.get(), Spectrum(1), with);
  EXPECT_GT(with.covered, 8);
}

TEST_F(SingleScatteringTest, AutomaticGoesByCostAndSaysWhy) {
  const auto decide = [&](int64_t samples, const RatioPlaces& there) {
    const SingleScatteringPlan plan =
        single_scattering_plan(*world, {.expected_samples = samples}, camera, there);
    EXPECT_EQ(plan.decisions.size(), 2);
    EXPECT_FALSE(plan.decisions[1 - light].on);
    EXPECT_EQ(plan.decisions[1 - light].reason, "it has no extent");
    return plan.decisions[light];
  };
  const Decision few = decide(1000, {});
  EXPECT_FALSE(few.on);
  EXPECT_NE(few.what.find("\"lamp\""), std::string::npos) << few.what;
  EXPECT_NE(few.reason.find("records"), std::string::npos) << few.reason;
  EXPECT_TRUE(decide(int64_t{1} << 40, {}).on);
}

TEST_F(SingleScatteringTest, RecordsThatAreThereAreFree) {
  const auto decide = [&](int64_t samples, const RatioPlaces& there) {
    return single_scattering_plan(*world, {.expected_samples = samples}, camera, there).decisions[light].on;
  };
  // 60 of about 2000 records are little; a picture for which the rest is just not worth it gains by them.
  int64_t least = 1;
  while (!decide(least, {}) && least < int64_t{1} << 40) least += least / 64 + 1;
  EXPECT_FALSE(decide(least - least / 65 - 1, {}));
  EXPECT_TRUE(decide(least - least / 65 - 1, ratio_places(*records)));
}

TEST_F(SingleScatteringTest, SmallLightsAndForwardScatteringAreSampled) {
  const auto reason = [](const char* radius, const char* phase) {
    const auto other =
        parse_world(std::string(R"(<medium type="homogeneous" id="fog"><phase type=")") + phase +
                    R"("/></medium>
      <sensor type="perspective"><ref name="medium" id="fog"/><film type="hdrfilm"/></sensor>
      <shape type="sphere"><point name="center" x="0" y="0" z="5"/><float name="radius" value=")" +
                    radius + R"("/><emitter type="area"/></shape>)");
    const Decision decision = single_scattering_plan(*other, {.single_scattering = SingleScattering::cached},
                                                     test::TestCamera(other->scene().sensor, 64, 64), {})
                                  .decisions[0];
    EXPECT_EQ(decision.on, decision.reason == "the settings ask for it");
    return decision.reason;
  };
  EXPECT_EQ(reason("0.5", "isotropic"), "the settings ask for it");
  EXPECT_NE(reason("0.01", "isotropic").find("pixels"), std::string::npos);
  EXPECT_NE(reason("0.5", "hg").find("all directions"), std::string::npos);
}

}  // namespace
}  // namespace fogbank::integrators
