// Integrators that prepare every pass: here photon beams, which trace photons anew for each.
#include <gtest/gtest.h>

#include <atomic>
#include <cmath>
#include <filesystem>
#include <optional>

#include "render/checkpoint.h"
#include "render/render_to_image.h"
#include "transport/world_builders.h"

namespace fogbank::render {
namespace {

std::shared_ptr<const transport::World> foggy_world() {
  return transport::test::parse_world(R"(
    <medium type="homogeneous" id="fog"><rgb name="sigma_t" value="0.5"/><rgb name="albedo" value="0.8"/></medium>
    <sensor type="perspective"><float name="fov" value="60"/>
      <transform name="to_world"><lookat origin="0, -1.8, 0" target="0, 0, 0" up="0, 0, 1"/></transform>
      <film type="hdrfilm"><integer name="width" value="24"/><integer name="height" value="16"/></film>
      <ref name="medium" id="fog"/></sensor>
    <shape type="cube"><transform name="to_world"><scale x="2" y="2" z="1"/></transform>
      <bsdf type="twosided"><bsdf type="diffuse"/></bsdf></shape>
    <emitter type="point"><point name="position" x="0.3" y="0.2" z="0.7"/></emitter>)");
}

RenderSettings settings_for(const transport::World& world) {
  RenderSettings settings;
  settings.integrator = "photon-beams";
  settings.samples_per_pixel = 5;
  settings.film = world.scene().film;
  settings.sensor = world.scene().sensor;
  settings.tile_size = 8;
  return settings;
}

TEST(PassPreparation, SamePictureForAnyThreadsTilesAndCrops) {
  const auto world = foggy_world();
  const RenderSettings settings = settings_for(*world);
  const Image one = render_to_image(world, settings, 1);
  EXPECT_EQ(one.samples, 5u);
  EXPECT_EQ(render_to_image(world, settings, 2).rgb, one.rgb);
  RenderSettings others = settings;
  others.tile_size = 16;
  others.tile_order = TileOrder::scan;
  EXPECT_EQ(render_to_image(world, others, 7).rgb, one.rgb);

  RenderSettings part = settings;
  part.film.crop = {5, 3, 11, 9};
  const Image cropped = render_to_image(world, part, 2);
  for (int32_t y = 0; y < 9; ++y) {
    for (int32_t x = 0; x < 11 * 3; ++x) {
      EXPECT_EQ(cropped.rgb[static_cast<size_t>(y * 33 + x)],
                one.rgb[static_cast<size_t>((y + 3) * 72 + 15 + x)]);
    }
  }
}

TEST(PassPreparation, FewerSamplesAreTheFirstOfMore) {
  const auto world = foggy_world();
  RenderSettings settings = settings_for(*world);
  settings.samples_per_pixel = 1;
  const Image first = render_to_image(world, settings, 2);
  settings.samples_per_pixel = 5;
  RenderJob job(world, settings);
  EXPECT_EQ(job.progress().pass_count, 5u);
  // Task by task; when the first pass is done its tiles are those of the short job.
  const std::atomic<bool> stop = false;
  while (job.progress().passes_done == 0) {
    const std::optional<Task> task = job.next_task();
    ASSERT_TRUE(task.has_value());
    job.run(*task, stop);
  }
  EXPECT_EQ(job.image().rgb, first.rgb);
}

TEST(PassPreparation, BlurCountsAsBiasAndFalls) {
  const auto world = foggy_world();
  RenderSettings settings = settings_for(*world);
  // The noise that is taken off may leave nothing of a single picture's estimate.
  constexpr uint64_t seeds = 8;
  const auto bias = [&](int32_t samples) {
    settings.samples_per_pixel = samples;
    double squares = 0;
    for (settings.seed = 0; settings.seed < seeds; ++settings.seed) {
      RenderJob job(world, settings);
      run_to_completion(job, 2);
      const ErrorEstimate estimate = job.progress().estimate;
      EXPECT_DOUBLE_EQ(estimate.error.value(), std::hypot(estimate.noise.value(), estimate.bias));
      squares += estimate.bias * estimate.bias;
    }
    return std::sqrt(squares / seeds);
  };
  const double few = bias(4);
  EXPECT_GT(few, 0);
  // Radii fall to the cube root of 1 / 8; the estimate's own noise falls, too.
  EXPECT_LT(bias(32), 0.8 * few);
}

TEST(PassPreparation, AResumedJobKnowsItsBlur) {
  const auto world = foggy_world();
  const RenderSettings settings = settings_for(*world);
  RenderJob whole(world, settings);
  run_to_completion(whole, 2);
  const std::atomic<bool> stop = false;
  RenderJob begun(world, settings);
  while (begun.progress().passes_done < 3) begun.run(begun.next_task().value(), stop);
  const auto path = std::filesystem::path(testing::TempDir()) / "blurred.checkpoint";
  write_checkpoint(path, begun.checkpoint().value(), "job");
  RenderJob resumed(world, settings);
  resumed.resume(read_checkpoint(path, "job"));
  std::filesystem::remove(path);
  run_to_completion(resumed, 2);
  EXPECT_EQ(resumed.image().rgb, whole.image().rgb);
  EXPECT_EQ(resumed.progress().estimate.bias, whole.progress().estimate.bias);
}

TEST(PassPreparation, ATimeBudgetEndsAJobWithWholePasses) {
  const auto world = foggy_world();
  RenderSettings settings = settings_for(*world);
  settings.samples_per_pixel = RenderLimits::samples_per_pixel;
  settings.time_budget_seconds = 0.5;
  RenderJob job(world, settings);
  run_to_completion(job, 2);
  const Progress progress = job.progress();
  EXPECT_TRUE(progress.finished);
  EXPECT_GE(progress.passes_done, 1u);
  EXPECT_EQ(job.image().samples, progress.passes_done);
  EXPECT_EQ(progress.invalid_samples, 0u);
}

TEST(PassPreparation, AJobCancelledWhileAPassIsPreparedEnds) {
  const auto world = foggy_world();
  RenderJob job(world, settings_for(*world));
  const std::atomic<bool> stop = false;
  std::optional<Task> task = job.next_task();
  while (task && !std::holds_alternative<PreparationTask>(*task)) {
    job.run(*task, stop);
    task = job.next_task();
  }
  ASSERT_TRUE(task.has_value());
  EXPECT_FALSE(job.progress().preparing) << "passes' preparations belong to them";
  job.cancel();
  job.run(*task, stop);
  EXPECT_TRUE(job.ended());
  EXPECT_FALSE(job.next_task().has_value());
}

}  // namespace
}  // namespace fogbank::render
