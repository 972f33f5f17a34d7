// The sphere grid's sum against closed forms.
#include <gtest/gtest.h>

#include "derivatives/path_source.h"
#include "derivatives/plan_request.h"
#include "derivatives/sphere_gather.h"
#include "derivatives/triangle_form_factor.h"
#include "transport/world_builders.h"

namespace fogbank::derivatives {
namespace {

using transport::test::parse_world;

/// A closed room of a cube, with what else stands in it.
std::string room(const std::string& contents, double sigma_t = 0) {
  const std::string fog = sigma_t > 0
                              ? R"(<medium type="homogeneous" id="fog"><rgb name="sigma_t" value=")" +
                                    std::to_string(sigma_t) + R"("/><rgb name="albedo" value="0.5"/></medium>
        <sensor type="perspective"><ref id="fog"/></sensor>)"
                              : "";
  return fog + R"(<shape type="cube"><transform name="to_world"><scale x="2" y="3" z="1"/></transform>
    <bsdf type="diffuse"><rgb name="reflectance" value="0.5"/></bsdf></shape>
    <emitter type="constant"><rgb name="radiance" value="1"/></emitter>)" +
         contents;
}

const std::string blockers = R"(
  <shape type="sphere"><point name="center" x="0.8" y="1" z="0.2"/><float name="radius" value="0.3"/></shape>
  <shape type="cube"><transform name="to_world"><scale value="0.2"/><rotate z="1" angle="30"/>
    <translate x="-1" y="-0.5" z="-0.3"/></transform></shape>)";

PathTracedSource path_traced(const std::shared_ptr<const transport::World>& world) {
  return {std::make_shared<transport::PathTracer>(world, transport::PathSettings{}), 1};
}

/// The gather's answer if every surface sent out radiance 1 in all directions.
RadianceJet lit_uniformly(const std::shared_ptr<const transport::World>& world, const Vec3f& x,
                          const EstimatorSettings& settings) {
  const transport::Plan plan(*world, plan_request(settings));
  const SphereGather gather(world, settings);
  SphereSamples samples(*world, plan);
  RandomStream random(settings.seed, 1, 2, 3);
  RayCounters counters;
  gather.trace(x, world->medium_at(x), random, samples, counters);
  // Different enough for all jumps to be worth an outline.
  for (Spectrum& radiance : samples.radiance) radiance = Spectrum(random.next_float());
  gather.find_outlines(samples, counters);
  samples.radiance.assign(samples.rays.ends().size(), Spectrum(1));
  return gather.gather(samples);
}

/// Largest entries, of all channels.
double gradient_size(const RadianceJet& jet) {
  double size = 0;
  for (const Jet3d& channel : jet.channels)
    for (int i = 0; i < 3; ++i) size = std::max(size, std::abs(channel.gradient[i]));
  return size;
}
double hessian_size(const RadianceJet& jet) {
  double size = 0;
  for (const Jet3d& channel : jet.channels)
    for (const double entry : channel.hessian.entries) size = std::max(size, std::abs(entry));
  return size;
}

TEST(SphereGather, UniformRoomHasNoDerivatives) {
  const auto world = parse_world(room(blockers));
  for (const bool bisect : {false, true}) {
    for (const int32_t samples : {64, 1024, 4096}) {
      EstimatorSettings settings;
      settings.samples = samples;
      settings.bisect = bisect;
      settings.order = Order::single;
      const RadianceJet jet = lit_uniformly(world, {0.1f, 0.2f, -0.1f}, settings);
      for (const Jet3d& channel : jet.channels) EXPECT_DOUBLE_EQ(channel.value, 1);
      // Rounding of sums of single-precision terms, the nearest surfaces 0.4 away. Between the two points of
      // an outline edges are short, and the Hessian's terms large.
      EXPECT_LT(gradient_size(jet), 2e-6) << samples << bisect;
      EXPECT_LT(hessian_size(jet), 2e-5) << samples << bisect;
    }
  }
}

/// In a fog that absorbs, x in the middle of a sphere of radiance 1 and radius R: exp(-sigma R), no gradient,
/// and the Hessian of the mean over the sphere of exp(-sigma d): d^2/dx^2 of
/// (1/4pi) int exp(-sigma |R w - x|) dw' with solid angle measured at x.
TEST(SphereGather, MiddleOfASphereInFog) {
  constexpr double sigma = 0.7;
  constexpr double radius = 2;
  const auto world = parse_world(R"(<medium type="homogeneous" id="fog"><rgb name="sigma_t" value="0.7"/>
      <rgb name="albedo" value="0.5"/></medium><sensor type="perspective"><ref id="fog"/></sensor>
    <shape type="sphere"><float name="radius" value="2"/><boolean name="flip_normals" value="true"/></shape>
    <emitter type="constant"><rgb name="radiance" value="1"/></emitter>)");
  EstimatorSettings settings;
  settings.order = Order::single;
  settings.samples = 4096;
  const RadianceJet jet = lit_uniformly(world, {0, 0, 0}, settings);
  const double through = std::exp(-sigma * radius);
  // Along w from x: d = sqrt(R^2 - x^2 (1 - c^2)) - x c with c the cosine between w and x; to second order in
  // x the mean over w of exp(-sigma d) is T (1 + x^2 (sigma^2 / 6 + sigma / (3 R))).
  const double second = 2 * through * (sigma * sigma / 6 + sigma / (3 * radius));
  for (const Jet3d& channel : jet.channels) {
    EXPECT_NEAR(channel.value, through, 1e-5);
    for (int i = 0; i < 3; ++i) {
      EXPECT_NEAR(channel.gradient[i], 0, 2e-3 * through);
      for (int j = i; j < 3; ++j)
        EXPECT_NEAR(channel.hessian(i, j), i == j ? second : 0, 0.02 * second) << i << j;
    }
  }
}

/// Without occluders a constant environment sends the same from everywhere.
TEST(SphereGather, OpenSkyHasNoDerivatives) {
  const auto world =
      parse_world(R"(<emitter type="constant"><rgb name="radiance" value="0.5 1 2"/></emitter>)");
  EstimatorSettings settings;
  settings.order = Order::single;
  const RadianceJet jet = lit_uniformly(world, {3, 4, 5}, settings);
  // What lit_uniformly adds to the rays' own emission is 1.
  EXPECT_NEAR(jet.channels[0].value, 1.5, 1e-6);
  EXPECT_NEAR(jet.channels[2].value, 3, 1e-6);
  EXPECT_EQ(gradient_size(jet), 0);
  EXPECT_EQ(hessian_size(jet), 0);
}

/// A plate before the sky: what the sky sends is 1 - the plate's form factor, in closed form.
TEST(SphereGather, PlateBeforeTheSky) {
  const auto world = parse_world(R"(<emitter type="constant"><rgb name="radiance" value="1"/></emitter>
    <shape type="rectangle"><bsdf type="diffuse"><rgb name="reflectance" value="0"/></bsdf></shape>)");
  const Vec3f x(0.3f, -0.2f, 1.2f);
  EstimatorSettings settings;
  settings.order = Order::single;
  settings.samples = 4096;
  Jet3d expected = Jet3d::constant(1);
  const Vec3d corners[4] = {{-1, -1, 0}, {1, -1, 0}, {1, 1, 0}, {-1, 1, 0}};
  for (const auto& [a, b, c] : {std::array{0, 1, 2}, std::array{0, 2, 3}}) {
    Jet3d jet = triangle_form_factor_jet(
        RelativeTriangle<double>::from_world(Vec3d(x), corners[a], corners[b], corners[c]));
    if (jet.value < 0) jet *= -1;
    expected -= jet;
  }
  const transport::Plan plan(*world, plan_request(settings));
  const SphereGather gather(world, settings);
  SphereSamples samples(*world, plan);
  RadianceJet mean;
  RayCounters counters;
  constexpr int repeats = 16;
  for (uint32_t repeat = 0; repeat < repeats; ++repeat) {
    RandomStream random(1, 2, 3, repeat);
    gather.trace(x, scene::none, random, samples, counters);
    gather.sample_radiance(path_traced(world), random, samples, counters);
    gather.find_outlines(samples, counters);
    RadianceJet jet = gather.gather(samples);
    jet *= 1.0 / repeats;
    mean += jet;
  }
  // Errors at 64^2 directions with 4 bisections; corners of the plate within cells stay blunt.
  EXPECT_NEAR(mean.channels[1].value, expected.value, 2e-3);
  EXPECT_LT(glm::length(mean.channels[1].gradient - expected.gradient),
            0.02 * glm::length(expected.gradient));
  EXPECT_LT((mean.channels[1].hessian - expected.hessian).norm(), 0.1 * expected.hessian.norm());
}

/// A flat mirror under a black ball: the ball is seen as one at the mirrored place.
TEST(SphereGather, FlatMirrorShowsVirtualImages) {
  const auto world = parse_world(R"(<emitter type="constant"><rgb name="radiance" value="1"/></emitter>
    <shape type="rectangle"><bsdf type="conductor"><string name="material" value="none"/></bsdf></shape>
    <shape type="sphere"><point name="center" x="0" y="0" z="2"/><float name="radius" value="0.5"/>
      <bsdf type="diffuse"><rgb name="reflectance" value="0"/></bsdf></shape>)");
  EstimatorSettings settings;
  settings.order = Order::single;
  settings.samples = 4096;
  const transport::Plan plan(*world, plan_request(settings));
  const SphereGather gather(world, settings);
  SphereSamples samples(*world, plan);
  RandomStream random(1, 2, 3, 4);
  RayCounters counters;
  const Vec3f x(0.2f, 0.1f, 0.7f);
  gather.trace(x, scene::none, random, samples, counters);
  gather.sample_radiance(path_traced(world), random, samples, counters);
  const SphereRays& rays = samples.rays;
  int images = 0;
  double sky = 0;
  int skies = 0;
  for (size_t i = 0; i < rays.ends().size(); ++i) {
    const RayEnd& end = rays.ends()[i];
    if (!end.is_mirrored) continue;
    if (!std::isfinite(end.distance)) {
      sky += samples.radiance[i].x;
      ++skies;
      continue;
    }
    // On the mirrored sphere around (0, 0, -2), normal outwards.
    ++images;
    const Vec3f image = x + end.distance * rays.lines().direction(i) - Vec3f(0, 0, -2);
    EXPECT_NEAR(glm::length(image), 0.5f, 1e-5f);
    EXPECT_NEAR(glm::dot(image, end.normal), 0.5f, 1e-5f);
    EXPECT_EQ(samples.radiance[i], Spectrum(0));
  }
  EXPECT_GT(images, 5);
  // Paths survive roulette with a probability of 0.999: 5 standard deviations of the mean.
  EXPECT_NEAR(sky / skies, 1, 5 * std::sqrt(1e-3 / skies));
}

}  // namespace
}  // namespace fogbank::derivatives
