// Pictures of which single scattering comes from ratio records, against sampled ones.
#include <gtest/gtest.h>

#include <bit>
#include <cmath>

#include "cache/scene_cache.h"
#include "integrators/picture.h"
#include "transport/world_builders.h"

namespace fogbank::integrators {
namespace {

using test::Picture;
using test::TestCamera;
using transport::test::parse_world;

constexpr int32_t side = 24;
/// Paths of two edges: single scattering, and surfaces are black.
constexpr int32_t max_depth = 2;
constexpr uint32_t samples = 128;

/// Black walls in fog, a light of finite size below the ceiling.
const std::string room = R"(
  <medium type="homogeneous" id="fog"><rgb name="sigma_t" value="0.1, 0.2, 0.3"/><rgb name="albedo" value="0.8"/></medium>
  <sensor type="perspective">
    <float name="fov" value="60"/>
    <transform name="to_world"><lookat origin="0, -1.8, 0" target="0, 0, 0" up="0, 0, 1"/></transform>
    <ref name="medium" id="fog"/>
  </sensor>
  <bsdf type="diffuse" id="black"><rgb name="reflectance" value="0"/></bsdf>
  <shape type="cube"><transform name="to_world"><scale x="2" y="2" z="1"/></transform><ref id="black"/></shape>
  <shape type="rectangle" id="lamp">
    <transform name="to_world"><rotate x="1" angle="180"/><scale value="0.4"/><translate z="0.99"/></transform>
    <ref id="black"/><emitter type="area"><rgb name="radiance" value="10, 9, 7"/></emitter>
  </shape>)";
const std::string plate = R"(
  <shape type="rectangle"><transform name="to_world"><scale value="0.5"/></transform><ref id="black"/></shape>)";

struct Rendered {
  Picture picture;
  CacheCounts counts;
};

Rendered render(const std::shared_ptr<const transport::World>& world, SingleScattering technique,
                uint32_t count, double error = 0.02, int threads = 2,
                std::shared_ptr<cache::SceneCache> cache = nullptr) {
  const auto integrator =
      make_integrator("radiance-cache", world,
                      {.max_depth = max_depth, .single_scattering = technique, .cache = std::move(cache)});
  const TestCamera camera(world->scene().sensor, side, side);
  test::prepare(*integrator, camera, {.error = error}, threads);
  return {test::take(*integrator, camera, count, threads), integrator->cache_counts()};
}

/// Root mean square over the pixels of the difference over the reference's luminance plus a tenth of its
/// mean. Pictures of equally many samples have the same camera rays, so that edges don't count.
double relative_error(const Picture& picture, const Picture& reference) {
  double mean = 0;
  for (const Spectrum& pixel : reference.mean)
    mean += static_cast<double>(luminance(pixel)) / static_cast<double>(reference.mean.size());
  double sum = 0;
  for (size_t i = 0; i < reference.mean.size(); ++i) {
    const auto wanted = static_cast<double>(luminance(reference.mean[i]));
    const double difference = static_cast<double>(luminance(picture.mean[i])) - wanted;
    sum += std::pow(difference / (wanted + 0.1 * mean), 2);
  }
  return std::sqrt(sum / static_cast<double>(reference.mean.size()));
}

class CachedSingleScattering : public ::testing::Test {
 protected:
  std::shared_ptr<const transport::World> world = parse_world(room + plate);
};

TEST_F(CachedSingleScattering, ErrsByLessThanWasAskedForAndLessForMoreRecords) {
  const Picture reference = render(world, SingleScattering::direct, samples).picture;
  const Rendered coarse = render(world, SingleScattering::cached, samples, 10);
  const Rendered fine = render(world, SingleScattering::cached, samples, 0.02);
  EXPECT_GT(fine.counts.records_new, coarse.counts.records_new);
  EXPECT_LT(relative_error(fine.picture, reference), 0.02);
  EXPECT_LT(relative_error(fine.picture, reference), relative_error(coarse.picture, reference));
}

TEST_F(CachedSingleScattering, IsExactWhereNothingBlocksTheLight) {
  const auto open = parse_world(room);
  const Picture reference = render(open, SingleScattering::direct, samples).picture;
  const Rendered cached = render(open, SingleScattering::cached, samples);
  // Noise of 512 samples, 0.1 %; transmittance of the middles of pieces and cells, less.
  EXPECT_LT(relative_error(cached.picture, reference), 0.002);
}

TEST_F(CachedSingleScattering, RecordsThatAreThereAreReadAndNoneIsMade) {
  const auto cache = std::make_shared<cache::SceneCache>();
  const Rendered cold = render(world, SingleScattering::cached, 4, 0.02, 2, cache);
  const Rendered warm = render(world, SingleScattering::cached, 4, 0.02, 2, cache);
  EXPECT_GT(cold.counts.records_new, 100);
  EXPECT_EQ(warm.counts.records_reused, cold.counts.records_new);
  // The rounds of one job end with a few places left.
  EXPECT_LE(warm.counts.records_new, cold.counts.records_new / 100);

  // No ray but the camera's, and where no record reaches.
  const auto integrator = make_integrator(
      "radiance-cache", world,
      {.max_depth = max_depth, .single_scattering = SingleScattering::cached, .cache = cache});
  const TestCamera camera(world->scene().sensor, side, side);
  test::prepare(*integrator, camera, {}, 1);
  RayCounters counters;
  for (uint32_t y = 0; y < side; ++y)
    for (uint32_t x = 0; x < side; ++x) {
      RandomStream random(1, x, y, 0);
      const Ray ray = camera.sample(x, y, random);
      integrator->sample(ray, random, counters);
    }
  EXPECT_LT(counters.any_hit, 0.05 * 4 * side * side);
}

TEST_F(CachedSingleScattering, IsTheSameToTheBitForAnyNumberOfThreads) {
  const Rendered one = render(world, SingleScattering::cached, 2, 0.1, 1);
  for (const int threads : {2, 7}) {
    const Rendered several = render(world, SingleScattering::cached, 2, 0.1, threads);
    ASSERT_EQ(several.counts.records_new, one.counts.records_new);
    for (size_t i = 0; i < one.picture.mean.size(); ++i)
      for (int c = 0; c < 3; ++c)
        ASSERT_EQ(std::bit_cast<uint32_t>(several.picture.mean[i][c]),
                  std::bit_cast<uint32_t>(one.picture.mean[i][c]));
  }
}

}  // namespace
}  // namespace fogbank::integrators
