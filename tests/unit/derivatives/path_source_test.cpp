// The path-traced source: what the medium sends to a point agrees with brute force, and its derivatives with
// differences of the same.
#include "derivatives/path_source.h"

#include <gtest/gtest.h>

#include <cmath>

#include "core/sampling.h"
#include "derivatives/direction_grid.h"
#include "derivatives/medium_gather.h"
#include "derivatives/medium_rays.h"
#include "scene/loader.h"
#include "scene/memory_files.h"

namespace fogbank::derivatives {
namespace {

/// Two media side by side in a room: coloured fog, and a ball of denser smoke behind a null boundary; a light
/// under the ceiling and a pillar before it.
const char* const room = R"(<scene version="3.0.0">
  <medium type="homogeneous" id="fog">
    <rgb name="sigma_t" value="0.4, 0.6, 0.9"/><rgb name="albedo" value="0.9, 0.7, 0.8"/>
  </medium>
  <medium type="homogeneous" id="smoke">
    <rgb name="sigma_t" value="3, 2, 1"/><rgb name="albedo" value="0.5, 0.7, 0.9"/>
  </medium>
  <sensor type="perspective"><ref name="medium" id="fog"/></sensor>
  <shape type="cube"><boolean name="flip_normals" value="true"/>
    <bsdf type="diffuse"><rgb name="reflectance" value="0.6, 0.4, 0.2"/></bsdf></shape>
  <shape type="rectangle">
    <transform name="to_world"><scale value="0.5"/><rotate x="1" angle="90"/><translate y="0.9"/></transform>
    <emitter type="area"><rgb name="radiance" value="8, 6, 4"/></emitter></shape>
  <shape type="cylinder"><float name="radius" value="0.15"/>
    <point name="p0" x="0.5" y="-1" z="0.3"/><point name="p1" x="0.5" y="0.4" z="0.3"/>
    <bsdf type="twosided"><bsdf type="diffuse"/></bsdf></shape>
  <shape type="sphere"><float name="radius" value="0.3"/><point name="center" x="-0.5" y="-0.4" z="-0.3"/>
    <bsdf type="null"/><ref name="interior" id="smoke"/><ref name="exterior" id="fog"/></shape>
</scene>)";

std::shared_ptr<const transport::World> load(const char* xml) {
  scene::prepare_render_thread();
  return std::make_shared<transport::World>(scene::load_scene(
      "scene.xml",
      std::make_shared<scene::test::MemoryFiles>(std::map<std::string, std::string>{{"scene.xml", xml}}),
      {}));
}

struct Mean {
  Vec3d sum{0};
  Vec3d squares{0};
  double count = 0;

  void add(const Vec3d& sample) {
    sum += sample;
    squares += sample * sample;
    ++count;
  }
  Vec3d mean() const { return sum / count; }
  Vec3d variance() const { return (squares / count - mean() * mean()) / count; }
};

/// One sample of the mean radiance at x from the medium alone: a uniform direction, a distance along it by a
/// density of no merit, and the kernel there. Shares neither strata nor lines of sight with what it checks.
Vec3d brute_force(const transport::World& world, const MediumSource& source, const Vec3f& x,
                  RandomStream& random, RayCounters& counters) {
  const Vec3f direction = square_to_uniform_sphere(random.next_vec2());
  const float distance = -std::log(1 - random.next_float());
  const float pdf = std::exp(-distance);
  const Spectrum visible = world.visibility(x, direction, distance, world.medium_at(x), counters);
  if (is_black(visible)) return Vec3d(0);
  const Vec3f y = x + direction * distance;
  const int32_t medium = world.medium_at(y);
  return Vec3d(visible * world.medium(medium).sigma_s * source.mean_radiance(y, medium, random, counters)) /
         static_cast<double>(pdf);
}

RadianceJet gather(const transport::World& world, const MediumSource& source, const Vec3f& x, int32_t n,
                   uint32_t sample, DerivativeOrder order, RayCounters& counters) {
  RandomStream random(31, sample, 0, 0);
  const std::shared_ptr<const DirectionTopology> topology = DirectionTopology::of(n);
  Sightlines lines(world);
  lines.start(x, world.medium_at(x));
  const std::vector<Vec3f> directions = stratified_directions(*topology, random);
  const float unlimited = infinity;
  lines.append(directions, std::span(&unlimited, 1), counters);
  return MediumGather(world, source)
      .gather(x, medium_rays(lines), topology->triangles(), {}, order, random, counters);
}

TEST(PathTracedSource, ValueAgreesWithBruteForce) {
  const std::shared_ptr<const transport::World> world = load(room);
  for (const int32_t max_depth : {3, 5, -1}) {
    SCOPED_TRACE(max_depth);
    const PathTracedSource source(
        std::make_shared<transport::PathTracer>(world, transport::PathSettings{max_depth, 2, false}), 1);
    // In the fog before and behind the pillar, and in the smoke.
    for (const Vec3f& x : {Vec3f(0.1f, 0.2f, 0.1f), Vec3f(0.8f, -0.3f, 0.4f), Vec3f(-0.45f, -0.4f, -0.2f)}) {
      Mean gathered;
      Mean expected;
      RayCounters counters;
      for (uint32_t i = 0; i < 30; ++i) {
        const RadianceJet jet = gather(*world, source, x, 8, i, DerivativeOrder::value, counters);
        gathered.add({jet.channels[0].value, jet.channels[1].value, jet.channels[2].value});
      }
      for (uint32_t i = 0; i < 15000; ++i) {
        RandomStream random(32, i, 0, 0);
        expected.add(brute_force(*world, source, x, random, counters));
      }
      for (int c = 0; c < 3; ++c) {
        // Four standard errors, as seeds are fixed and 27 numbers compared.
        const double error = std::sqrt(gathered.variance()[c] + expected.variance()[c]);
        EXPECT_NEAR(gathered.mean()[c], expected.mean()[c], 4 * error) << "channel " << c;
        EXPECT_LT(error, 0.05 * expected.mean()[c]);
      }
    }
  }
}

/// Too short a path for the medium: camera, x, y, light are three edges.
TEST(PathTracedSource, NothingArrivesAlongTwoEdges) {
  const std::shared_ptr<const transport::World> world = load(room);
  const PathTracedSource source(
      std::make_shared<transport::PathTracer>(world, transport::PathSettings{2, 2, false}), 1);
  RayCounters counters;
  const RadianceJet jet =
      gather(*world, source, Vec3f(0.1f, 0.2f, 0.1f), 8, 0, DerivativeOrder::hessian, counters);
  for (const Jet3d& channel : jet.channels) {
    EXPECT_EQ(channel.value, 0);
    EXPECT_EQ(glm::length(channel.gradient), 0);
    EXPECT_EQ(channel.hessian.norm(), 0);
  }
}

/// An all-white world: everything is 1 everywhere, so the medium's share has a gradient of its own, that of
/// E(d) to the walls, and path tracing must not add to it.
TEST(PathTracedSource, DerivativesAreThoseOfAUniformSource) {
  const std::shared_ptr<const transport::World> world = load(R"(<scene version="3.0.0">
    <medium type="homogeneous" id="fog"><rgb name="sigma_t" value="0.7"/><rgb name="albedo" value="1"/></medium>
    <sensor type="perspective"><ref name="medium" id="fog"/></sensor>
    <shape type="cube"><boolean name="flip_normals" value="true"/>
      <bsdf type="diffuse"><rgb name="reflectance" value="0.5"/></bsdf>
      <emitter type="area"><rgb name="radiance" value="0.5"/></emitter></shape>
  </scene>)");
  class One final : public MediumSource {
   public:
    Spectrum mean_radiance(const Vec3f&, int32_t, RandomStream&, RayCounters&) const override {
      return Spectrum(1);
    }
    bool exact() const override { return true; }
  };
  const PathTracedSource source(std::make_shared<transport::PathTracer>(world, transport::PathSettings{}), 1);
  const Vec3f x(0.3f, -0.2f, 0.1f);
  RayCounters counters;
  const Jet3d truth = gather(*world, One(), x, 32, 0, DerivativeOrder::hessian, counters).channels[1];
  constexpr int repeats = 16;
  std::array<Mean, 3> rows;
  Mean gradient;
  Mean value;
  for (uint32_t i = 0; i < repeats; ++i) {
    const Jet3d jet = gather(*world, source, x, 16, i, DerivativeOrder::hessian, counters).channels[1];
    value.add(Vec3d(jet.value));
    gradient.add(jet.gradient);
    for (int row = 0; row < 3; ++row)
      rows[static_cast<size_t>(row)].add({jet.hessian(row, 0), jet.hessian(row, 1), jet.hessian(row, 2)});
  }
  // Five standard errors estimated from 16 (Student's t: 1 in 6000), and the grids' own differences.
  const auto expect = [](const Mean& found, int i, double expected) {
    EXPECT_NEAR(found.mean()[i], expected, 5 * std::sqrt(found.variance()[i]) + 0.01);
  };
  expect(value, 0, truth.value);
  for (int i = 0; i < 3; ++i) {
    expect(gradient, i, truth.gradient[i]);
    for (int j = 0; j < 3; ++j) expect(rows[static_cast<size_t>(i)], j, truth.hessian(i, j));
  }
}

}  // namespace
}  // namespace fogbank::derivatives
