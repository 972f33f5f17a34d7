#include "derivatives/surface_radiance.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <numeric>

#include "derivatives/path_source.h"
#include "scene/loader.h"
#include "scene/memory_files.h"

namespace fogbank::derivatives {
namespace {

/// A white wall, a grey wall and a black one in a sky of radiance 1: what they send is their reflectance.
const char* const walls = R"(<scene version="3.0.0">
  <sensor type="perspective"/>
  <shape type="rectangle"><transform name="to_world"><translate x="-4"/></transform>
    <bsdf type="diffuse"><rgb name="reflectance" value="0.8"/></bsdf></shape>
  <shape type="rectangle">
    <bsdf type="diffuse"><rgb name="reflectance" value="0.2, 0.4, 0.1"/></bsdf></shape>
  <shape type="rectangle"><transform name="to_world"><translate x="4"/></transform>
    <bsdf type="diffuse"><rgb name="reflectance" value="0"/></bsdf></shape>
  <emitter type="constant"><rgb name="radiance" value="1"/></emitter>
</scene>)";

class SurfaceRadiance : public ::testing::Test {
 protected:
  SurfaceRadiance() {
    scene::prepare_render_thread();
    world_ = std::make_shared<transport::World>(scene::load_scene(
        "scene.xml",
        std::make_shared<scene::test::MemoryFiles>(std::map<std::string, std::string>{{"scene.xml", walls}}),
        {}));
  }

  SurfaceHit hit(const Vec3f& target, float importance = 1) const {
    const Ray ray{target + Vec3f(0.3f, -0.2f, 1), glm::normalize(Vec3f(-0.3f, 0.2f, -1)), infinity};
    scene::Hit found;
    EXPECT_TRUE(world_->scene().intersector->intersect(ray, found));
    return {world_->scene().interaction(ray, found), ray.direction, scene::none, importance};
  }

  std::shared_ptr<const transport::World> world_;
};

TEST_F(SurfaceRadiance, IsTheReflectanceInAWhiteSky) {
  const PathTracedSource source(std::make_shared<transport::PathTracer>(world_, transport::PathSettings{}),
                                1);
  const std::vector<SurfaceHit> hits{hit({-4, 0, 0}), hit({0, 0.5f, 0}), hit({4, 0, 0}), hit({0, 0, 0}, 0)};
  RandomStream random(5, 0, 0, 0);
  RayCounters counters;
  const std::vector<Spectrum> radiance = surface_radiance(*world_, source, hits, 4000, random, counters);
  // Both techniques of a sample see the same sky, so that their weighted sum strays by a few percent of one
  // sample's value only: 1 % is more than four standard errors of the mean of a thousand.
  const Spectrum expected[] = {Spectrum(0.8f), {0.2f, 0.4f, 0.1f}, Spectrum(0), Spectrum(0)};
  for (size_t i = 0; i < hits.size(); ++i)
    for (int c = 0; c < 3; ++c) EXPECT_NEAR(radiance[i][c], expected[i][c], 0.01f) << i;
}

TEST_F(SurfaceRadiance, EndsWithThePath) {
  // Camera, point, wall, sky: three edges.
  const PathTracedSource source(
      std::make_shared<transport::PathTracer>(world_, transport::PathSettings{2, 2, false}), 1);
  RandomStream random(5, 0, 0, 0);
  RayCounters counters;
  EXPECT_TRUE(is_black(
      surface_radiance(*world_, source, std::vector<SurfaceHit>{hit({0, 0, 0})}, 10, random, counters)[0]));
}

TEST_F(SurfaceRadiance, BudgetIsSharedOutByImportance) {
  std::vector<SurfaceHit> hits;
  for (int i = 0; i < 50; ++i) {
    hits.push_back(hit({-4, 0, 0}, 1));
    hits.push_back(hit({-4, 0, 0}, 0.25f));
    hits.push_back(hit({4, 0, 0}));
    hits.push_back(hit({-4, 0, 0}, 0));
  }
  const std::vector<int32_t> counts = share_out(*world_, hits, 1150);
  EXPECT_EQ(std::accumulate(counts.begin(), counts.end(), 0), 1150);
  for (size_t i = 0; i < hits.size(); i += 4) {
    // 1000 beyond the first ones: 16 and 4 for each pair.
    EXPECT_NEAR(counts[i], 17, 1);
    EXPECT_NEAR(counts[i + 1], 5, 1);
    EXPECT_EQ(counts[i + 2], 1);
    EXPECT_EQ(counts[i + 3], 0);
  }
  // Too little for all: still one each, or the mean would be wrong.
  const std::vector<int32_t> few = share_out(*world_, hits, 10);
  EXPECT_EQ(std::accumulate(few.begin(), few.end(), 0), 150);
}

TEST(FilterOverNeighbours, KeepsTheSumAndStaysOnItsSurface) {
  // A torus of 8 x 8 vertices, half of them on another surface.
  constexpr uint32_t n = 8;
  GridNeighbours neighbours(n * n);
  std::vector<uint32_t> surfaces(n * n);
  std::vector<Spectrum> radiance(n * n);
  RandomStream random(9, 0, 0, 0);
  for (uint32_t i = 0; i < n; ++i) {
    for (uint32_t j = 0; j < n; ++j) {
      size_t k = 0;
      for (const uint32_t di : {n - 1, 0u, 1u})
        for (const uint32_t dj : {n - 1, 0u, 1u})
          if (di != 0 || dj != 0) neighbours[i * n + j][k++] = (i + di) % n * n + (j + dj) % n;
      surfaces[i * n + j] = j < n / 2 ? 7 : 3;
      const float skewed = sqr(sqr(random.next_float()));
      radiance[i * n + j] = (j < n / 2 ? 1.0f : 100.0f) * Spectrum(skewed, 1, 0);
    }
  }
  const std::vector<Spectrum> filtered = filter_over_neighbours(radiance, neighbours, surfaces);
  for (const uint32_t surface : {7u, 3u}) {
    double before = 0;
    double after = 0;
    double spread_before = 0;
    double spread_after = 0;
    for (size_t i = 0; i < radiance.size(); ++i) {
      if (surfaces[i] != surface) continue;
      before += static_cast<double>(radiance[i].x);
      after += static_cast<double>(filtered[i].x);
      spread_before += static_cast<double>(sqr(radiance[i].x));
      spread_after += static_cast<double>(sqr(filtered[i].x));
      // Smoothing changes nothing that is smooth already.
      EXPECT_NEAR(filtered[i].y, radiance[i].y, 1e-6f * radiance[i].y);
      EXPECT_EQ(filtered[i].z, 0);
    }
    EXPECT_NEAR(after, before, 1e-6 * before);
    // Independent noise of nine vertices in the interior, of six along the border.
    const double mean = before * before / 32;
    EXPECT_LT(spread_after - mean, 0.4 * (spread_before - mean));
  }
}

}  // namespace
}  // namespace fogbank::derivatives
