// Photons that end the paths of records.
#include "cache/photon_field.h"

#include <gtest/gtest.h>

#include <cmath>
#include <thread>

#include "cache/record_maker.h"
#include "core/sampling.h"
#include "scene/intersector.h"
#include "transport/path_tracer.h"
#include "transport/world_builders.h"

namespace fogbank::cache {
namespace {

using transport::test::parse_world;

constexpr uint32_t paths = 1 << 17;

/// A ball of fog of radius 1 in a sky of radiance 1. With albedo 1 radiance is 1 everywhere, and what comes
/// to a place without having been scattered is the mean of exp(-sigma_t d) over directions.
std::shared_ptr<const transport::World> ball(const std::string& sigma_t, const std::string& albedo) {
  return parse_world(R"(<medium type="homogeneous" id="fog"><rgb name="sigma_t" value=")" + sigma_t +
                     R"("/><rgb name="albedo" value=")" + albedo + R"("/></medium>
    <sensor type="perspective"><ref name="medium" id="fog"/></sensor>
    <shape type="sphere"><float name="radius" value="1"/><bsdf type="null"/>
      <ref name="interior" id="fog"/></shape>
    <emitter type="constant"><rgb name="radiance" value="1"/></emitter>)");
}

/// A closed room in fog, [-1, 1]^3, with a lamp, a block, and a thin wall at x = 0.7 from side to side.
std::shared_ptr<const transport::World> room() {
  return parse_world(R"(<medium type="homogeneous" id="fog"><rgb name="sigma_t" value="2"/>
      <rgb name="albedo" value="0.9"/></medium>
    <sensor type="perspective"><ref name="medium" id="fog"/></sensor>
    <shape type="cube"><boolean name="flip_normals" value="true"/>
      <bsdf type="twosided"><bsdf type="diffuse"><rgb name="reflectance" value="0.6"/></bsdf></bsdf></shape>
    <shape type="cube"><transform name="to_world"><scale value="0.3"/><translate x="0.2" y="-0.2" z="-0.7"/>
      </transform><bsdf type="diffuse"><rgb name="reflectance" value="0.5"/></bsdf></shape>
    <shape type="rectangle"><transform name="to_world"><rotate y="1" angle="90"/><translate x="0.7"/>
      </transform><bsdf type="twosided"><bsdf type="diffuse"/></bsdf></shape>
    <shape type="sphere"><point name="center" x="-0.4" y="0.3" z="0.6"/><float name="radius" value="0.15"/>
      <emitter type="area"><rgb name="radiance" value="10"/></emitter></shape>)");
}

std::shared_ptr<PhotonField> field_of(const std::shared_ptr<const transport::World>& world, int threads = 1) {
  scene::prepare_render_thread();
  auto field = std::make_shared<PhotonField>(world, paths, -1);
  std::vector<std::thread> others;
  for (int i = 1; i < threads; ++i)
    others.emplace_back([&] {
      scene::prepare_render_thread();
      RayCounters counters;
      field->complete(counters);
    });
  RayCounters counters;
  field->complete(counters);
  for (std::thread& other : others) other.join();
  return field;
}

struct Mean {
  double value = 0;
  double variance = 0;  ///< of the value
};

template <typename Sample>
Mean mean_of(int count, const Sample& sample) {
  double sum = 0;
  double squares = 0;
  for (int i = 0; i < count; ++i) {
    const auto one = static_cast<double>(sample());
    sum += one / count;
    squares += one * one / count;
  }
  return {sum, (squares - sum * sum) / count};
}

TEST(PhotonField, LosslessFogIsAsBrightAsTheSky) {
  const auto world = ball("2", "1");
  const auto field = field_of(world);
  RandomStream random(3, 0, 0, 0);
  double sum = 0;
  constexpr int points = 64;
  for (int i = 0; i < points; ++i) {
    const Vec3f x =
        0.6f * (2.0f * Vec3f(random.next_float(), random.next_float(), random.next_float()) - 1.0f);
    if (glm::length(x) > 0.8f) {
      sum += 1.0 / points;
      continue;
    }
    const auto scattered = field->scattered_before(x, 0);
    ASSERT_TRUE(scattered);
    double direct = 0;
    constexpr int directions = 400;
    for (int j = 0; j < directions; ++j) {
      const float cosine = 2 * (static_cast<float>(j) + 0.5f) / directions - 1;
      const float r = glm::length(x);
      direct +=
          static_cast<double>(std::exp(-2 * (-r * cosine + std::sqrt(1 - r * r * (1 - cosine * cosine))))) /
          directions;
    }
    sum += (static_cast<double>(scattered->y) + direct) / points;
  }
  // Six seeds of a quarter of the paths had a standard deviation of 3.6 %: four times half of that.
  EXPECT_NEAR(sum, 1, 0.072);
}

TEST(PhotonField, CellsThatSurfacesCrossAreNotUsed) {
  const auto field = field_of(room());
  EXPECT_TRUE(field->scattered_before({-0.3f, -0.3f, 0}, 0));
  EXPECT_FALSE(field->scattered_before({-0.3f, -0.3f, 0.99f}, 0));
  EXPECT_FALSE(field->scattered_before({0.71f, 0.1f, 0.1f}, 0));
  EXPECT_FALSE(field->scattered_before({0.2f, -0.2f, -0.41f}, 0));
  EXPECT_FALSE(field->scattered_before({5, 5, 5}, 0));
}

TEST(PhotonField, NothingLeaksThroughWalls) {
  const auto field = field_of(room());
  RandomStream random(5, 0, 0, 0);
  int known = 0;
  for (int i = 0; i < 2000; ++i) {
    const Vec3f x(0.7f + 0.3f * random.next_float(), 2 * random.next_float() - 1,
                  2 * random.next_float() - 1);
    const auto scattered = field->scattered_before(x, 0);
    if (!scattered) continue;
    ++known;
    ASSERT_EQ(*scattered, Spectrum(0)) << x.x << ' ' << x.y << ' ' << x.z;
  }
  EXPECT_GT(known, 500);
}

TEST(PhotonField, IsTheSameForAnyThreadsAndAfterInterruptions) {
  const auto world = room();
  const auto one = field_of(world);
  const auto three = field_of(world, 3);
  const auto resumed = std::make_shared<PhotonField>(world, paths, -1);
  const std::atomic<bool> stop = true;
  RayCounters interrupted;
  interrupted.stop = &stop;
  EXPECT_THROW(resumed->complete(interrupted), Interrupted);
  RayCounters counters;
  resumed->complete(counters);
  RandomStream random(6, 0, 0, 0);
  for (int i = 0; i < 200; ++i) {
    const Vec3f x = 2.0f * Vec3f(random.next_float(), random.next_float(), random.next_float()) - 1.0f;
    const auto expected = one->scattered_before(x, 0);
    EXPECT_EQ(three->scattered_before(x, 0), expected);
    EXPECT_EQ(resumed->scattered_before(x, 0), expected);
  }
}

/// Mean radiance at places all over the lit part of the room, close to walls too.
TEST(PhotonField, PathsThatEndThereAgreeWithThoseThatGoOn) {
  const auto world = room();
  const transport::PathTracer whole(world, {});
  const transport::PathTracer ended(world, {}, field_of(world));
  RandomStream random(7, 0, 0, 0);
  RayCounters long_paths;
  RayCounters short_paths;
  constexpr int count = 40000;
  const auto somewhere = [&] {
    return Vec3f(-1 + 1.69f * random.next_float(), 2 * random.next_float() - 1,
                 1.69f * random.next_float() - 0.69f);
  };
  const auto lit = [&](const Vec3f& x) { return glm::distance(x, Vec3f(-0.4f, 0.3f, 0.6f)) > 0.16f; };
  const auto mean = [&](const transport::PathTracer& kernel, RayCounters& counters) {
    return mean_of(count, [&] {
      Vec3f x = somewhere();
      while (!lit(x)) x = somewhere();
      return luminance(kernel.mean_radiance(x, 0, 1, random, counters));
    });
  };
  const Mean expected = mean(whole, long_paths);
  const Mean found = mean(ended, short_paths);
  // Four standard errors, and 2 % for the photons' own noise, which all places share: 10 % at one place (six
  // seeds of a quarter of the paths), of which there are hundreds that don't overlap.
  EXPECT_NEAR(found.value, expected.value,
              4 * std::sqrt(expected.variance + found.variance) + 0.02 * expected.value);
  EXPECT_LT(short_paths.total(), 0.7 * static_cast<double>(long_paths.total()));
}

TEST(PhotonField, RecordsOfPhotonsAgreeWithRecordsOfPaths) {
  const auto world = room();
  const auto photons = field_of(world);
  for (const bool on_surface : {false, true}) {
    const Quantity quantity = on_surface ? Quantity::irradiance : Quantity::rest;
    const Vec3f x = on_surface ? Vec3f(-0.5f, -0.4f, -1) : Vec3f(0.1f, 0.2f, 0.1f);
    const Vec3f normal = on_surface ? Vec3f(0, 0, 1) : Vec3f(0);
    std::array<Mean, 2> means;
    std::array<uint64_t, 2> rays{};
    constexpr int seeds = 16;
    for (const uint8_t generation : {uint8_t{0}, uint8_t{1}}) {
      for (uint64_t seed = 0; seed < seeds; ++seed) {
        const auto maker = make_record_maker(
            quantity, world, {.samples = 64, .seed = seed, .photons = generation == 1 ? photons : nullptr});
        RayCounters counters;
        const Record record = maker->make({x, normal, {0, 0, generation, quantity}}, counters);
        EXPECT_NO_THROW(validate(record));
        means[generation].value += static_cast<double>(luminance(record.radiance)) / seeds;
        means[generation].variance += static_cast<double>(record.variance) / (seeds * seeds);
        rays[generation] += record.samples;
      }
    }
    // Four standard errors, and what photons have in common: gathers over all directions average it.
    EXPECT_NEAR(means[1].value, means[0].value,
                4 * std::sqrt(means[0].variance + means[1].variance) + 0.03 * means[0].value)
        << on_surface;
    EXPECT_LT(rays[1], rays[0]) << on_surface;
  }
}

TEST(PhotonField, RecordsAreNamedByTheirPhotons) {
  const auto world = ball("1", "0.9");
  RayCounters counters;
  const auto id_of = [&](std::shared_ptr<PhotonField> photons) {
    return make_record_maker(Quantity::rest, world, {.samples = 16, .photons = std::move(photons)})
        ->make({Vec3f(0.1f), Vec3f(0), {0, 0, 1, Quantity::rest}}, counters)
        .id;
  };
  const uint64_t few = id_of(std::make_shared<PhotonField>(world, 100, -1));
  EXPECT_EQ(few, id_of(std::make_shared<PhotonField>(world, 100, -1)));
  EXPECT_NE(few, id_of(std::make_shared<PhotonField>(world, 200, -1)));
  EXPECT_NE(few, id_of(nullptr));
}

}  // namespace
}  // namespace fogbank::cache
