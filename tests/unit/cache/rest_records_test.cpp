// Records in fog that scatters anisotropically, against closed forms and paths.
#include <gtest/gtest.h>

#include <array>
#include <cmath>

#include "cache/index.h"
#include "cache/record_maker.h"
#include "core/sampling.h"
#include "transport/path_tracer.h"
#include "transport/world_builders.h"

namespace fogbank::cache {
namespace {

using transport::test::parse_world;

std::string fog(const std::string& sigma_t, const std::string& albedo, const std::string& g) {
  return R"(<medium type="homogeneous" id="fog"><rgb name="sigma_t" value=")" + sigma_t +
         R"("/><rgb name="albedo" value=")" + albedo + R"("/><phase type="hg"><float name="g" value=")" + g +
         R"("/></phase></medium><sensor type="perspective"><ref name="medium" id="fog"/></sensor>)";
}

/// A ball of fog of radius 1 and albedo 1 in a sky of radiance 1: the radiance is 1 everywhere in every
/// direction, whatever the phase function, and what of it comes straight from the sky is exp(-sigma_t d).
std::shared_ptr<const transport::World> furnace(const std::string& g) {
  return parse_world(fog("1", "1", g) + R"(<shape type="sphere"><float name="radius" value="1"/>
    <bsdf type="null"/><ref name="interior" id="fog"/></shape>
    <emitter type="constant"><rgb name="radiance" value="1"/></emitter>)");
}

/// Radiance straight from the sky, seen from `x` in the ball.
float direct_light(const Vec3f& x, const Vec3f& direction) {
  const float along = glm::dot(x, direction);
  return std::exp(-(std::sqrt(along * along + 1 - glm::dot(x, x)) - along));
}

/// Mean over the sphere, by stratified directions.
template <typename Function>
double mean_over_sphere(const Function& function) {
  constexpr int side = 128;
  double sum = 0;
  for (int row = 0; row < side; ++row)
    for (int column = 0; column < side; ++column) {
      const Vec2f u(static_cast<float>(column) + 0.5f, static_cast<float>(row) + 0.5f);
      sum += static_cast<double>(function(square_to_uniform_sphere(u / static_cast<float>(side))));
    }
  return sum / (side * side);
}

/// A closed room with a coloured floor, a lamp and a block.
std::shared_ptr<const transport::World> room(const std::string& g) {
  return parse_world(fog("0.5, 0.6, 0.8", "0.9", g) + R"(
    <shape type="cube"><boolean name="flip_normals" value="true"/>
      <bsdf type="twosided"><bsdf type="diffuse"><rgb name="reflectance" value="0.3"/></bsdf></bsdf></shape>
    <shape type="rectangle"><transform name="to_world"><scale value="0.99"/><translate z="-0.98"/></transform>
      <bsdf type="twosided"><bsdf type="diffuse"><rgb name="reflectance" value="0.9, 0.4, 0.1"/></bsdf>
      </bsdf></shape>
    <shape type="cube"><transform name="to_world"><scale value="0.3"/><translate x="0.5" y="-0.2" z="-0.2"/>
      </transform><bsdf type="diffuse"><rgb name="reflectance" value="0.5"/></bsdf></shape>
    <shape type="sphere"><point name="center" x="-0.4" y="0.3" z="0.7"/><float name="radius" value="0.15"/>
      <emitter type="area"><rgb name="radiance" value="10"/></emitter></shape>)");
}

/// Records of one place with different seeds.
std::vector<Record> records_at(const std::shared_ptr<const transport::World>& world, const Vec3f& x,
                               int32_t samples, uint64_t count) {
  std::vector<Record> records;
  for (uint64_t seed = 0; seed < count; ++seed) {
    RayCounters counters;
    records.push_back(make_record_maker(Quantity::directional_rest, world, {.samples = samples, .seed = seed})
                          ->make({x, Vec3f(0), {0, 0, 0, Quantity::directional_rest}}, counters));
  }
  return records;
}

struct Mean {
  double value = 0;
  double error = 0;  ///< standard error
};

template <typename Sample>
Mean mean_of(size_t count, const Sample& sample) {
  double sum = 0;
  double squares = 0;
  for (size_t i = 0; i < count; ++i) {
    const auto one = static_cast<double>(sample(i));
    sum += one;
    squares += one * one;
  }
  const double mean = sum / static_cast<double>(count);
  return {mean, std::sqrt(std::max(squares / static_cast<double>(count) - mean * mean, 0.0) /
                          static_cast<double>(count - 1))};
}

TEST(DirectionalRecords, MomentsOfAFurnaceAreThoseOfTheClosedForm) {
  const Vec3f x(0.3f, -0.2f, 0.4f);
  const auto expected = [&](const auto& weight) {
    return mean_over_sphere([&](const Vec3f& w) { return weight(w) * (1 - direct_light(x, w)); });
  };
  for (const char* g : {"-0.4", "0.3", "0.6"}) {
    const std::vector<Record> records = records_at(furnace(g), x, 64, 48);
    const Mean mean = mean_of(records.size(), [&](size_t i) { return records[i].radiance.y; });
    EXPECT_NEAR(mean.value, expected([](const Vec3f&) { return 1.0f; }), 4 * mean.error) << g;
    for (size_t k = 0; k < HarmonicMoments::colour_count; ++k) {
      const Mean moment = mean_of(records.size(), [&](size_t i) {
        return records[i].radiance.y * records[i].shape.moments().colour[k].y;
      });
      // Besides noise, the rounding of small numbers beside large ones.
      EXPECT_NEAR(moment.value, expected([&](const Vec3f& w) { return spherical_harmonics(w)[k]; }),
                  4 * moment.error + 1e-3)
          << g << ' ' << k;
    }
  }
}

TEST(DirectionalRecords, GradientsAreThoseOfIsotropicFogAlmost) {
  // In a furnace the mean radiance that was scattered before has the same gradient whatever the phase
  // function.
  const Vec3f x(0.3f, -0.2f, 0.4f);
  const Vec3f outwards = glm::normalize(x);
  const auto at = [&](const Vec3f& y) {
    return mean_over_sphere([&](const Vec3f& w) { return -direct_light(y, w); });
  };
  const double slope = (at(x + 0.01f * outwards) - at(x - 0.01f * outwards)) / 0.02;
  for (const char* g : {"0", "-0.4", "0.3", "0.6"}) {
    const std::vector<Record> records = records_at(furnace(g), x, 1024, 6);
    const Mean found =
        mean_of(records.size(), [&](size_t i) { return glm::dot(records[i].gradient[1], outwards); });
    EXPECT_NEAR(found.value, slope, 0.2 * std::fabs(slope) + 4 * found.error) << g;
  }
}

TEST(DirectionalRecords, SayWhatPathsSayIsScatteredAlongARay) {
  const Vec3f x(-0.1f, -0.3f, -0.5f);
  constexpr uint32_t path_count = 4000;
  for (const char* g : {"0.3", "-0.5"}) {
    const auto world = room(g);
    const std::vector<Record> records = records_at(world, x, 64, 32);
    const transport::PathTracer kernel(world, {});
    const transport::PhaseFunction& phase = world->medium(0).phase;
    RandomStream directions(4, 0, 0, 0);
    for (uint32_t n = 0; n < 3; ++n) {
      const Vec3f ray = square_to_uniform_sphere(directions.next_vec2());
      const ScatteredDirection scattered(phase, ray);
      std::vector<Spectrum> paths;
      for (uint32_t i = 0; i < path_count; ++i) {
        RandomStream random(5, i, n, 0);
        RayCounters counters;
        scene::Hit hit;
        paths.push_back(kernel.arriving_radiance(
            {x, phase.sample(ray, random.next_vec2()).direction, infinity}, 0, 1, random, counters, &hit));
      }
      for (int channel = 0; channel < 3; ++channel) {
        const Mean found = mean_of(records.size(), [&](size_t i) {
          return records[i].radiance[channel] * scattered.share(records[i].shape)[channel];
        });
        const Mean expected = mean_of(path_count, [&](size_t i) { return paths[i][channel]; });
        // 2 % for degrees above 3 and, in degree 3, colours.
        EXPECT_NEAR(found.value, expected.value,
                    4 * std::hypot(found.error, expected.error) + 0.02 * expected.value)
            << g << ' ' << n << ' ' << channel;
      }
    }
  }
}

TEST(DirectionalRecords, IsotropicFogIsAsItWas) {
  // The same light and random numbers: only the component, and with it the id, and the shape differ.
  const auto world = parse_world(R"(<medium type="homogeneous" id="fog"><rgb name="sigma_t" value="0.7"/>
    </medium><sensor type="perspective"><ref name="medium" id="fog"/></sensor>
    <shape type="cube"><boolean name="flip_normals" value="true"/></shape>
    <shape type="sphere"><float name="radius" value="0.2"/>
      <emitter type="area"><rgb name="radiance" value="3"/></emitter></shape>)");
  std::array<Record, 2> records;
  for (const Quantity quantity : {Quantity::rest, Quantity::directional_rest}) {
    RayCounters counters;
    records[quantity == Quantity::rest ? 0 : 1] =
        make_record_maker(quantity, world, {.samples = 64})
            ->make({Vec3f(0.4f, 0.3f, -0.2f), Vec3f(0), {0, 0, 0, quantity}}, counters);
  }
  EXPECT_TRUE(records[0].shape.is_even());
  EXPECT_FALSE(records[1].shape.is_even());
  EXPECT_NE(records[0].id, records[1].id);
  EXPECT_EQ(records[0].radiance, records[1].radiance);
  EXPECT_EQ(records[0].gradient, records[1].gradient);
  EXPECT_EQ(records[0].variance, records[1].variance);
  EXPECT_EQ(records[0].samples, records[1].samples);
}

/// A record with light from above, and what look-ups make of it.
Record lit_from_above(float brightness, uint64_t id) {
  HarmonicMoments moments;
  moments.colour[1] = Vec3f(1, 0.5f, 0);  // of sqrt(3) z
  Record record;
  record.id = id;
  record.component.quantity = Quantity::directional_rest;
  record.radiance = Spectrum(brightness);
  record.gradient.fill(Vec3f(0.1f * brightness, 0, 0));
  record.shape = DirectionalShape::from_moments(moments);
  return record;
}

TEST(DirectionalRecords, LookUpsScaleWhatIsExtrapolatedAndBlendByTheSameWeights) {
  const transport::PhaseFunction phase(0.5f);
  const ScatteredDirection up(phase, {0, 0, 1});
  const float share = 1 + 0.5f * std::sqrt(3.0f);
  Record second = lit_from_above(3, 2);
  second.samples = 3;
  second.shape = {};
  const auto epoch_of = [](std::vector<Record> records) {
    MetricSettings settings;
    settings.threshold = 1;
    settings.radiance_floor = 1;
    settings.maximum_radius = 2;
    return Epoch(std::make_shared<const RecordSet>(std::move(records)), settings);
  };
  const Epoch one = epoch_of({lit_from_above(1, 1)});
  const Index& index = *one.find({0, 0, 0, Quantity::directional_rest});
  const Vec3f point(0.2f, 0.1f, 0);
  const float mean = index.look_up(point).radiance.x;
  EXPECT_NEAR(mean, 1.02f, 1e-5f);
  const Spectrum towards = index.look_up(point, &up).radiance;
  // To a 127th of the greatest number of the shape.
  EXPECT_NEAR(towards.x, mean * share, 0.01f);
  EXPECT_NEAR(towards.z, mean, 0.01f);
  EXPECT_FLOAT_EQ(index.extrapolated_by(0, point, &up).x, towards.x);
  EXPECT_EQ(index.look_up(point, &up).weight, index.look_up(point).weight);

  // Two records of one place: by samples.
  const Epoch two = epoch_of({lit_from_above(1, 1), second});
  EXPECT_NEAR(two.find({0, 0, 0, Quantity::directional_rest})->look_up(Vec3f(0), &up).radiance.x,
              (share + 3 * 3) / 4, 0.01f);
}

}  // namespace
}  // namespace fogbank::cache
