// The kernel's entries agree with each other: what leaves a surface and what arrives at a medium point,
// started there, are what camera rays find.
#include "transport/path_tracer.h"

#include <gtest/gtest.h>

#include <cmath>

#include "core/sampling.h"
#include "scene/loader.h"
#include "scene/memory_files.h"

namespace fogbank::transport {
namespace {

/// A room of 2 x 2 x 2 around the origin with a light under its ceiling, in fog that has a colour.
const char* const foggy_room = R"(<scene version="3.0.0">
  <medium type="homogeneous" id="fog">
    <rgb name="sigma_t" value="0.4, 0.6, 0.9"/><rgb name="albedo" value="0.9, 0.7, 0.8"/>
  </medium>
  <sensor type="perspective"><ref name="medium" id="fog"/></sensor>
  <shape type="cube"><boolean name="flip_normals" value="true"/>
    <bsdf type="diffuse"><rgb name="reflectance" value="0.6, 0.4, 0.2"/></bsdf></shape>
  <shape type="rectangle">
    <transform name="to_world"><scale value="0.4"/><rotate x="1" angle="90"/><translate y="0.9"/></transform>
    <emitter type="area"><rgb name="radiance" value="8, 6, 4"/></emitter></shape>
  <shape type="sphere"><float name="radius" value="0.3"/><point name="center" x="0.4" y="-0.5" z="0.2"/>
    <bsdf type="conductor"/></shape>
</scene>)";

/// A pane that lets half of the light through, before a bright sky; no medium.
const char* const half_pane = R"(<scene version="3.0.0">
  <sensor type="perspective"/>
  <shape type="rectangle"><bsdf type="mask"><float name="opacity" value="0.5"/>
    <bsdf type="twosided"><bsdf type="diffuse"><rgb name="reflectance" value="0.5"/></bsdf></bsdf></bsdf></shape>
  <emitter type="constant"><rgb name="radiance" value="1"/></emitter>
</scene>)";

std::shared_ptr<const World> load(const char* xml) {
  scene::prepare_render_thread();
  return std::make_shared<World>(scene::load_scene(
      "scene.xml",
      std::make_shared<scene::test::MemoryFiles>(std::map<std::string, std::string>{{"scene.xml", xml}}),
      {}));
}

/// Mean of samples and its standard error, per channel.
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

/// Each channel within 4 standard errors: 1 chance in 16,000 for a sound estimator, and the seeds are fixed.
void expect_agreement(const Mean& a, const Mean& b) {
  for (int c = 0; c < 3; ++c) {
    EXPECT_GT(a.mean()[c], 0);
    EXPECT_NEAR(a.mean()[c], b.mean()[c], 4 * std::sqrt(a.variance()[c] + b.variance()[c]))
        << "channel " << c;
  }
}

TEST(PathTracer, RadianceOfASurfaceIsEmissionPlusScatteredRadiance) {
  const std::shared_ptr<const World> world = load(half_pane);
  const PathTracer kernel(world, {});
  // Half of the sky behind, and half of it reflected by 0.5: what comes straight on isn't scattered.
  const Ray ray{Vec3f(0.1f, 0.2f, 1), Vec3f(0, 0, -1), infinity};
  scene::Hit hit;
  ASSERT_TRUE(world->scene().intersector->intersect(ray, hit));
  const scene::SurfaceInteraction surface = world->scene().interaction(ray, hit);
  Mean camera;
  Mean scattered;
  RayCounters counters;
  for (uint32_t i = 0; i < 4000; ++i) {
    RandomStream random(1, 0, 0, i);
    camera.add(kernel.radiance(ray, random, counters));
    scattered.add(kernel.scattered_radiance(surface, ray.direction, scene::none, 0, random, counters));
  }
  for (int c = 0; c < 3; ++c) {
    EXPECT_NEAR(camera.mean()[c], 0.75, 4 * std::sqrt(camera.variance()[c]));
    EXPECT_NEAR(scattered.mean()[c], 0.25, 4 * std::sqrt(scattered.variance()[c]) + 1e-6);
  }
}

TEST(PathTracer, ScatteredRadianceIsWhatACameraRayFindsBehindTheFog) {
  const std::shared_ptr<const World> world = load(foggy_room);
  const PathTracer kernel(world, {});
  // So near to the wall, and to the mirror, that the fog in between doesn't matter (1e-5 of it).
  for (const Vec3f target : {Vec3f(-1, 0.2f, 0.3f), Vec3f(0.4f, -0.2f, 0.2f)}) {
    const Vec3f away = target.x < 0 ? Vec3f(1, 0, 0) : Vec3f(0, 1, 0);
    const Ray ray{target + 1e-5f * away, -away, infinity};
    scene::Hit hit;
    ASSERT_TRUE(world->scene().intersector->intersect(ray, hit));
    const scene::SurfaceInteraction surface = world->scene().interaction(ray, hit);
    Mean camera;
    Mean scattered;
    RayCounters counters;
    for (uint32_t i = 0; i < 20000; ++i) {
      RandomStream random(2, 0, 0, i);
      camera.add(kernel.radiance(ray, random, counters));
      scattered.add(kernel.scattered_radiance(surface, ray.direction, 0, 0, random, counters));
    }
    expect_agreement(camera, scattered);
  }
}

TEST(PathTracer, MeanRadianceIsTheMeanOverDirections) {
  const std::shared_ptr<const World> world = load(foggy_room);
  const Vec3f x(-0.2f, 0.1f, 0.3f);
  // A path that scatters at x is one edge longer than what arrives there.
  for (const int32_t depth : {2, 3, 5, -1}) {
    SCOPED_TRACE(depth);
    const PathTracer arriving(world, {depth < 0 ? -1 : depth - 1, 2, false});
    const PathTracer at_point(world, {depth < 0 ? -1 : depth + 1, 2, false});
    Mean camera;
    Mean point;
    RayCounters counters;
    for (uint32_t i = 0; i < 40000; ++i) {
      RandomStream random(3, 0, 0, i);
      const Ray ray{x, square_to_uniform_sphere(random.next_vec2()), infinity};
      camera.add(arriving.radiance(ray, random, counters));
      // With one event before x the whole path may be one edge longer for the same light.
      point.add(at_point.mean_radiance(x, 0, 1, random, counters));
    }
    expect_agreement(camera, point);
  }
}

TEST(PathTracer, DepthLimitsWholePaths) {
  const std::shared_ptr<const World> world = load(foggy_room);
  const Vec3f x(0, 0.5f, 0);
  RayCounters counters;
  RandomStream random(4, 0, 0, 0);
  const PathTracer kernel(world, {3, 2, false});
  for (int i = 0; i < 100; ++i) {
    // Camera, two events, this one, the light: 4 edges.
    EXPECT_TRUE(is_black(kernel.mean_radiance(x, 0, 2, random, counters)));
  }
  EXPECT_EQ(counters.total(), 0u);
}

}  // namespace
}  // namespace fogbank::transport
