// Pictures that jobs render from a cache: windows of one picture, budgets of records.
#include <gtest/gtest.h>

#include "cache/scene_cache.h"
#include "function_integrator.h"
#include "transport/world_builders.h"

namespace fogbank::render {
namespace {

constexpr int32_t width = 40;
constexpr int32_t height = 36;

/// A lamp and a plate in a box of fog.
std::shared_ptr<const transport::World> room() {
  return transport::test::parse_world(R"(
    <medium type="homogeneous" id="fog"><rgb name="sigma_t" value="0.4"/><rgb name="albedo" value="0.8"/></medium>
    <sensor type="perspective"><float name="fov" value="60"/><ref name="medium" id="fog"/>
      <transform name="to_world"><lookat origin="0, -1.8, 0" target="0, 0, 0" up="0, 0, 1"/></transform></sensor>
    <bsdf type="twosided" id="wall"><bsdf type="diffuse"><rgb name="reflectance" value="0.5, 0.4, 0.3"/></bsdf></bsdf>
    <shape type="cube"><transform name="to_world"><scale x="2" y="2" z="1"/></transform><ref id="wall"/></shape>
    <shape type="rectangle"><transform name="to_world"><scale value="0.5"/></transform><ref id="wall"/></shape>
    <shape type="rectangle">
      <transform name="to_world"><rotate x="1" angle="180"/><scale value="0.4"/><translate z="0.99"/></transform>
      <emitter type="area"><rgb name="radiance" value="10, 9, 7"/></emitter>
    </shape>)");
}

struct Outcome {
  Image image;
  uint64_t records_new = 0;
};

Outcome picture(const std::shared_ptr<const transport::World>& world, const scene::Window& crop,
                const std::shared_ptr<cache::SceneCache>& cache, bool reads_only) {
  RenderSettings settings = small_settings(width, height, 2);
  settings.integrator = "radiance-cache";
  settings.sensor = world->scene().sensor;
  settings.film.crop = crop;
  settings.integrator_settings.cache = cache;
  if (reads_only) settings.integrator_settings.most_records = 0;
  RenderJob job(world, settings);
  run_to_completion(job, 2);
  return {job.image(), job.progress().records_new};
}

TEST(CachedPicture, WindowsThatReadTheSameRecordsHaveTheSamePixels) {
  const auto world = room();
  const auto cache = std::make_shared<cache::SceneCache>();
  const scene::Window whole{0, 0, width, height};
  EXPECT_GT(picture(world, whole, cache, false).records_new, 0u);
  const Image all = picture(world, whole, cache, true).image;
  for (const scene::Window crop : {scene::Window{0, 0, 8, 8}, {13, 7, 21, 25}, {39, 0, 1, height}}) {
    const Image part = picture(world, crop, cache, true).image;
    size_t at = 0;
    for (int32_t y = crop.y; y < crop.y + crop.height; ++y)
      for (int32_t x = 3 * crop.x; x < 3 * (crop.x + crop.width); ++x, ++at)
        ASSERT_EQ(part.rgb[at], all.rgb[static_cast<size_t>(3 * width * y + x)]) << x / 3 << ", " << y;
  }
}

TEST(CachedPicture, APartOfAPictureThatWasMadeNeedsFewRecords) {
  const auto world = room();
  const auto cache = std::make_shared<cache::SceneCache>();
  const uint64_t made = picture(world, {0, 0, width, height}, cache, false).records_new;
  // It looks at pixels that the whole picture's fill has looked at, but ends stages by its own estimate.
  const uint64_t more = picture(world, {13, 7, 21, 25}, cache, false).records_new;
  EXPECT_LT(more, made / 10) << made;
}

TEST(CachedPicture, ABudgetOfRecordsIsKept) {
  const auto world = room();
  RenderSettings settings = small_settings(width, height, 2);
  settings.integrator = "radiance-cache";
  settings.sensor = world->scene().sensor;
  settings.error = 0.05;
  for (const int64_t budget : {1, 20}) {
    settings.record_budget = budget;
    RenderJob job(world, settings);
    run_to_completion(job, 2);
    EXPECT_LE(job.progress().records_new, static_cast<uint64_t>(budget));
    EXPECT_GT(job.progress().records_new, 0u);
  }
}

}  // namespace
}  // namespace fogbank::render
