#include "integrators/radiance_cache.h"

#include <gtest/gtest.h>

#include <array>
#include <bit>
#include <cmath>

#include "cache/scene_cache.h"
#include "integrators/picture.h"
#include "transport/world_builders.h"

namespace fogbank::integrators {
namespace {

using test::Picture;
using test::TestCamera;

constexpr const char* sensor = R"(
  <sensor type="perspective">
    <float name="fov" value="60"/>
    <transform name="to_world"><lookat origin="0, -1.8, 0" target="0, 0, 0" up="0, 0, 1"/></transform>
    <ref name="medium" id="fog"/>
  </sensor>)";

std::string fog(const std::string& sigma_t, const std::string& albedo,
                const std::string& phase = "isotropic") {
  return R"(<medium type="homogeneous" id="fog"><rgb name="sigma_t" value=")" + sigma_t +
         R"("/><rgb name="albedo" value=")" + albedo + R"("/><phase type=")" + phase + R"(">)" +
         (phase == "hg" ? R"(<float name="g" value="0.6"/>)" : "") + "</phase></medium>" + sensor;
}

/// A room of 4 x 4 x 2 with a light below its ceiling and a plate below the light.
std::string room(const std::string& plate_bsdf) {
  return R"(
  <bsdf type="twosided" id="wall"><bsdf type="diffuse"><rgb name="reflectance" value="0.5, 0.4, 0.3"/></bsdf></bsdf>
  <shape type="cube"><transform name="to_world"><scale x="2" y="2" z="1"/></transform><ref id="wall"/></shape>
  <shape type="rectangle">
    <transform name="to_world"><rotate x="1" angle="180"/><scale value="0.4"/><translate x="0" y="0" z="0.99"/></transform>
    <bsdf type="diffuse"><rgb name="reflectance" value="0"/></bsdf>
    <emitter type="area"><rgb name="radiance" value="10, 9, 7"/></emitter>
  </shape>
  <shape type="rectangle"><transform name="to_world"><scale value="0.5"/></transform>)" +
         plate_bsdf + "</shape>";
}

const std::string diffuse_plate =
    R"(<bsdf type="twosided"><bsdf type="diffuse"><rgb name="reflectance" value="0.2, 0.5, 0.8"/></bsdf></bsdf>)";
const std::string rough_plate =
    R"(<bsdf type="twosided"><bsdf type="roughconductor"><float name="alpha" value="0.3"/></bsdf></bsdf>)";
const std::string glass_ball =
    R"(<shape type="sphere"><float name="radius" value="0.4"/><bsdf type="dielectric"/></shape>)";

std::unique_ptr<Integrator> make(const std::string& name, std::shared_ptr<const transport::World> world,
                                 IntegratorSettings settings = {}) {
  if (settings.rr_depth == IntegratorSettings{}.rr_depth) settings.rr_depth = 5;
  return make_integrator(name, std::move(world), settings);
}

/// Mean luminance of a picture and the variance of that mean.
struct Level {
  double mean = 0;
  double variance = 0;
};
Level level(const Picture& picture) {
  Level result;
  const auto count = static_cast<double>(picture.mean.size());
  for (size_t i = 0; i < picture.mean.size(); ++i) {
    result.mean += static_cast<double>(luminance(picture.mean[i])) / count;
    result.variance += picture.variance[i] / (count * count);
  }
  return result;
}

struct SmallScene {
  std::string name;
  std::string body;
  int32_t max_depth = -1;
};
std::ostream& operator<<(std::ostream& out, const SmallScene& scene) { return out << scene.name; }

class SmallScenes : public testing::TestWithParam<SmallScene> {};

TEST_P(SmallScenes, WithoutRecordsPathsTakeTheirPlaceUnbiased) {
  const auto world = transport::test::parse_world(GetParam().body);
  const TestCamera camera(world->scene().sensor, 8, 8);
  IntegratorSettings settings;
  settings.max_depth = GetParam().max_depth;
  const Level expected = level(take(*make("volpath", world, settings), camera, 256, 2));
  const Level found = level(take(*make("radiance-cache", world, settings), camera, 256, 2));
  EXPECT_GT(expected.mean, 0);
  // Four standard errors: 1 in 16000 by chance.
  EXPECT_NEAR(found.mean, expected.mean, 4 * std::sqrt(expected.variance + found.variance));
}

TEST_P(SmallScenes, WithRecordsTheTargetIsMet) {
  const auto world = transport::test::parse_world(GetParam().body);
  const TestCamera camera(world->scene().sensor, 8, 8);
  IntegratorSettings settings;
  settings.max_depth = GetParam().max_depth;
  settings.most_records = 40;
  const Level expected = level(take(*make("volpath", world, settings), camera, 256, 2));
  const auto integrator = make("radiance-cache", world, settings);
  constexpr double target = 0.2;
  prepare(*integrator, camera, {.error = target}, 2);
  EXPECT_LE(integrator->cache_counts().records_new, 40u);
  const Level found = level(take(*integrator, camera, 256, 2));
  EXPECT_NEAR(found.mean, expected.mean,
              target * expected.mean + 4 * std::sqrt(expected.variance + found.variance));
}

INSTANTIATE_TEST_SUITE_P(
    All, SmallScenes,
    testing::Values(SmallScene{"diffuse", fog("0.5", "0.8") + room(diffuse_plate)},
                    SmallScene{"two_bounces", fog("0.5", "0.8") + room(diffuse_plate), 3},
                    SmallScene{"chromatic", fog("0.1, 0.5, 2", "0.9, 0.5, 0.7") + room(diffuse_plate)},
                    SmallScene{"forward", fog("0.5", "0.8", "hg") + room(diffuse_plate)},
                    SmallScene{"rough", fog("0.3", "0.8") + room(rough_plate)},
                    SmallScene{"glass", fog("0.3", "0.8") + room(diffuse_plate) + glass_ball},
                    SmallScene{"unbounded", fog("0.4", "0.9") + R"(
  <shape type="sphere"><float name="radius" value="0.3"/><emitter type="area"><rgb name="radiance" value="4"/></emitter></shape>)"},
                    SmallScene{"vacuum",
                               R"(<medium type="homogeneous" id="fog"><rgb name="sigma_t" value="0"/>
  <rgb name="albedo" value="0"/></medium>)" +
                                   std::string(sensor) + room(diffuse_plate)}),
    [](const testing::TestParamInfo<SmallScene>& scene) { return scene.param.name; });

/// Everything that is in a cache, and a picture rendered with it, to the bit.
struct Outcome {
  std::vector<uint64_t> ids;
  std::vector<std::array<uint32_t, 3>> values;
  std::vector<std::array<uint32_t, 3>> pixels;
  bool operator==(const Outcome&) const = default;
};
using Bits = std::array<uint32_t, 3>;

Outcome outcome(const Integrator& integrator, const cache::SceneCache& records, const CameraRays& camera) {
  Outcome result;
  const auto set = records.records();
  for (size_t i = 0; i < set->size(); ++i) {
    const cache::Record record = set->record(i);
    result.ids.push_back(record.id);
    result.values.push_back(std::bit_cast<Bits>(record.radiance));
    result.values.push_back(std::bit_cast<Bits>(record.position));
    for (const Vec3f& gradient : record.gradient) result.values.push_back(std::bit_cast<Bits>(gradient));
  }
  for (const Spectrum& pixel : test::take(integrator, camera, 2, 2).mean)
    result.pixels.push_back(std::bit_cast<Bits>(pixel));
  return result;
}

void expect_same_for_any_threads(const std::string& phase) {
  const auto world = transport::test::parse_world(fog("0.5", "0.8", phase) + room(diffuse_plate));
  const TestCamera camera(world->scene().sensor, 12, 8);
  std::optional<Outcome> first;
  for (const int threads : {1, 2, 7}) {
    IntegratorSettings settings;
    settings.most_records = 40;
    settings.cache = std::make_shared<cache::SceneCache>();
    const auto integrator = make("radiance-cache", world, settings);
    prepare(*integrator, camera, {.error = 1}, threads);
    const Outcome found = outcome(*integrator, *settings.cache, camera);
    EXPECT_GT(found.ids.size(), 20u);
    if (!first) first = found;
    EXPECT_EQ(found, *first) << threads;
  }
}

TEST(RadianceCache, SameRecordsAndBitsForAnyThreads) { expect_same_for_any_threads("isotropic"); }
TEST(RadianceCache, SameRecordsAndBitsInAnisotropicFog) { expect_same_for_any_threads("hg"); }

/// A ball of fog of albedo 1 in a sky of radiance 1, seen from within: 1 everywhere.
TEST(RadianceCache, FurnaceOfAnisotropicFog) {
  for (const char* g : {"0.3", "-0.6"}) {
    const auto world = transport::test::parse_world(
        R"(<medium type="homogeneous" id="fog"><rgb name="sigma_t" value="1"/><rgb name="albedo" value="1"/>
      <phase type="hg"><float name="g" value=")" +
        std::string(g) + R"("/></phase></medium>
      <sensor type="perspective"><float name="fov" value="90"/>
        <transform name="to_world"><lookat origin="0, -0.7, 0.2" target="0, 0, 0" up="0, 0, 1"/></transform>
        <ref name="medium" id="fog"/></sensor>
      <shape type="sphere"><bsdf type="null"/><ref name="interior" id="fog"/></shape>
      <emitter type="constant"><rgb name="radiance" value="1"/></emitter>)");
    const TestCamera camera(world->scene().sensor, 8, 8);
    IntegratorSettings settings;
    settings.cache = std::make_shared<cache::SceneCache>();
    const auto integrator = make("radiance-cache", world, settings);
    prepare(*integrator, camera, {.error = 0.2, .preview = true}, 2);
    ASSERT_FALSE(settings.cache->records()->components().empty());
    EXPECT_EQ(settings.cache->records()->components()[0].component.quantity,
              cache::Quantity::directional_rest);
    const Picture picture = take(*integrator, camera, 256, 2);
    const Level found = level(picture);
    // Records of 64 directions have 5 % of noise each, of which many enter the mean.
    EXPECT_NEAR(found.mean, 1, 0.02 + 4 * std::sqrt(found.variance)) << g;
    for (size_t i = 0; i < picture.mean.size(); ++i)
      EXPECT_NEAR(luminance(picture.mean[i]), 1, 0.1 + 4 * std::sqrt(picture.variance[i])) << g << ' ' << i;
  }
}

TEST(RadianceCache, SaysWhatAnisotropicFogGets) {
  const auto decision = [](const std::string& name, const std::string& g) {
    const auto world = transport::test::parse_world(
        R"(<medium type="homogeneous" id="fog"><phase type="hg"><float name="g" value=")" + g +
        R"("/></phase></medium>)" + sensor);
    return make(name, world)->decisions().at(0);
  };
  const Decision cached = decision("radiance-cache", "-0.6");
  EXPECT_EQ(cached.what, "records in medium \"fog\"");
  EXPECT_TRUE(cached.on);
  EXPECT_EQ(
      cached.reason,
      "its phase function has a mean cosine of -0.60: they hold how light is spread over directions, up to "
      "degree 3");
  const Decision narrow = decision("radiance-cache", "0.85");
  EXPECT_FALSE(narrow.on);
  EXPECT_EQ(narrow.reason,
            "its phase function has a mean cosine of 0.85, too narrow for what records hold (at most 0.60)");
  EXPECT_FALSE(decision("radiance-cache-unaware", "0.3").on);
}

TEST(RadianceCache, SecondCameraReusesWhatTheFirstOneLeftInOneProcessOrAcrossARestart) {
  const auto world = transport::test::parse_world(fog("0.5", "0.8") + room(diffuse_plate));
  const TestCamera first(world->scene().sensor, 8, 8);
  scene::Sensor moved = world->scene().sensor;
  moved.to_world[3] += glm::dvec4(0.5, 0.2, 0.1, 0);
  const TestCamera second(moved, 8, 8);
  constexpr CacheTarget target{.error = 1};

  IntegratorSettings together;
  together.cache = std::make_shared<cache::SceneCache>();
  prepare(*make("radiance-cache", world, together), first, target, 2);
  const size_t after_first = together.cache->records()->size();

  // The set of the first camera as a store would bring it back: merged into nothing, twice over.
  IntegratorSettings restarted;
  restarted.cache = std::make_shared<cache::SceneCache>();
  std::vector<cache::Record> stored;
  for (size_t i = after_first; i-- > 0;) stored.push_back(together.cache->records()->record(i));
  restarted.cache->add(stored);
  restarted.cache->add(stored);

  std::vector<Outcome> outcomes;
  for (const IntegratorSettings& settings : {together, restarted}) {
    const auto integrator = make("radiance-cache", world, settings);
    prepare(*integrator, second, target, 2);
    EXPECT_EQ(integrator->cache_counts().records_reused, after_first);
    EXPECT_LT(integrator->cache_counts().records_new, after_first);
    outcomes.push_back(outcome(*integrator, *settings.cache, second));
  }
  EXPECT_EQ(outcomes[0], outcomes[1]);
}

TEST(RadianceCache, TheSameCameraNeedsNextToNothingMore) {
  const auto world = transport::test::parse_world(fog("0.5", "0.8") + room(diffuse_plate));
  const TestCamera camera(world->scene().sensor, 32, 32);
  IntegratorSettings settings;
  settings.cache = std::make_shared<cache::SceneCache>();
  settings.single_scattering = SingleScattering::direct;
  prepare(*make("radiance-cache", world, settings), camera, {.error = 0.3}, 2);
  const auto again = make("radiance-cache", world, settings);
  prepare(*again, camera, {.error = 0.3}, 2);
  // The last records of a stride may shrink extents that covered the strides before.
  EXPECT_GT(again->cache_counts().records_reused, 50u);
  EXPECT_LE(again->cache_counts().records_new, again->cache_counts().records_reused / 20);
}

TEST(RadianceCache, ViewTellsWhatLooksUpRestOn) {
  const auto world = transport::test::parse_world(fog("0.5", "0.8") + room(diffuse_plate));
  const TestCamera camera(world->scene().sensor, 16, 16);
  IntegratorSettings settings;
  settings.most_records = 40;
  const auto integrator = make("radiance-cache", world, settings);
  RayCounters counters;
  RandomStream random(0, 3, 3, 0);
  const Ray ray = camera.sample(3, 3, random);
  EXPECT_EQ(integrator->cache_view(ray, random, counters).record_density, 0);
  prepare(*integrator, camera, {.error = 0.5}, 2);
  const CacheView view = integrator->cache_view(ray, random, counters);
  EXPECT_GT(view.radius, 0);
  EXPECT_LE(view.radius, 0.25f * world->scene().bounds.radius * 1.001f);
  EXPECT_GE(view.record_density, 0.5f);
  EXPECT_GT(view.variance, 0);
  EXPECT_GT(view.bias, 0);
}

TEST(RadianceCache, FinerTargetsPutMoreSamplesBehindRecords) {
  const auto world = transport::test::parse_world(fog("0.5", "0.8") + room(diffuse_plate));
  const TestCamera camera(world->scene().sensor, 16, 16);
  std::array<double, 2> variances{};
  for (size_t i = 0; i < 2; ++i) {
    IntegratorSettings settings;
    settings.cache = std::make_shared<cache::SceneCache>();
    settings.single_scattering = SingleScattering::direct;
    settings.most_records = 4000;
    const auto integrator = make("radiance-cache", world, settings);
    // Few extents in both: what differs is the noise that is tolerable.
    prepare(*integrator, camera, {.error = i == 0 ? 0.3 : 0.05, .preview = true}, 2);
    size_t more = 0;
    for (const cache::ComponentRange& range : settings.cache->records()->components())
      more += range.record_count - range.place_count;
    if (i == 1) {
      EXPECT_GT(more, 10u);
    }
    RayCounters counters;
    for (uint32_t y = 0; y < 16; ++y)
      for (uint32_t x = 0; x < 16; ++x) {
        RandomStream random(0, x, y, 0);
        const Ray ray = camera.sample(x, y, random);
        variances[i] += static_cast<double>(integrator->cache_view(ray, random, counters).variance);
      }
  }
  EXPECT_LT(variances[1], 0.5 * variances[0]);
}

TEST(RadianceCache, NothingToSeeIsBlackAndNeedsNothing) {
  for (const std::string& body :
       {fog("0.5", "0.8"), fog("0.5", "0.8") + R"(<shape type="cube"/>)",
        fog("0", "0") + R"(<shape type="cube"/>)", fog("0.5", "0") + R"(<shape type="cube"/>)"}) {
    const auto world = transport::test::parse_world(body);
    const TestCamera camera(world->scene().sensor, 4, 4);
    IntegratorSettings settings;
    settings.most_records = 30;
    const auto integrator = make("radiance-cache", world, settings);
    prepare(*integrator, camera, {.error = 0.02}, 2);
    for (const Spectrum& pixel : take(*integrator, camera, 2, 2).mean) EXPECT_EQ(pixel, Spectrum(0)) << body;
  }
}

TEST(RadianceCache, MostRecordsIsABudget) {
  const auto world = transport::test::parse_world(fog("0.5", "0.8") + room(diffuse_plate));
  const TestCamera camera(world->scene().sensor, 8, 8);
  IntegratorSettings settings;
  settings.most_records = 1;
  const auto integrator = make("radiance-cache", world, settings);
  prepare(*integrator, camera, {.error = 1e-6}, 2);
  EXPECT_LE(integrator->cache_counts().records_new, 1u);
  EXPECT_GT(level(take(*integrator, camera, 4, 2)).mean, 0);
}

}  // namespace
}  // namespace fogbank::integrators
