#include "render/render_job.h"

#include <gtest/gtest.h>

#include <chrono>
#include <map>
#include <set>
#include <stdexcept>
#include <thread>

#include "core/error.h"
#include "function_integrator.h"

namespace fogbank::render {
namespace {

const std::atomic<bool> never = false;

FunctionIntegrator::Function constant(float value) {
  return [value](const Ray&, RandomStream&, RayCounters& counters) {
    ++counters.any_hit;
    return Spectrum(value);
  };
}

/// The next task that renders; what comes before it is run.
std::optional<TileTask> next_tile_task(RenderJob& job) {
  for (;;) {
    const std::optional<Task> task = job.next_task();
    if (!task) return std::nullopt;
    if (const auto* const tile = std::get_if<TileTask>(&*task)) return *tile;
    job.run(*task, never);
  }
}

void run_pass(RenderJob& job) {
  while (!job.run(next_tile_task(job).value(), never)) {
  }
}

TEST(RenderJob, AnUntouchedJobIsBlack) {
  const RenderJob job(function_integrator(constant(1)), small_settings(40, 24, 4));
  EXPECT_EQ(job.tile_count(), 6u);
  const TilePixels tile = job.tile(5);
  EXPECT_EQ(tile.window, (scene::Window{32, 16, 8, 8}));
  EXPECT_EQ(tile.pass, 0u);
  EXPECT_EQ(tile.rgb, std::vector<float>(8 * 8 * 3));
  EXPECT_EQ(job.image().samples, 0u);
  EXPECT_EQ(job.image().rgb, std::vector<float>(40 * 24 * 3));
  EXPECT_EQ(job.progress().render_seconds, 0.0);
  EXPECT_THROW(job.tile(6), Error);
}

TEST(RenderJob, APassBeginsOnlyAfterTheOneBefore) {
  RenderJob job(function_integrator(constant(1)), small_settings(40, 24, 4));
  std::vector<TileTask> tasks;
  while (const auto task = next_tile_task(job)) tasks.push_back(*task);
  ASSERT_EQ(tasks.size(), 6u);
  std::set<uint32_t> tiles;
  for (const TileTask& task : tasks) {
    EXPECT_EQ(task.pass, 0u);
    tiles.insert(task.tile);
  }
  EXPECT_EQ(tiles.size(), 6u);
  for (size_t i = 0; i < 5; ++i) EXPECT_FALSE(job.run(tasks[i], never));
  EXPECT_FALSE(job.next_task().has_value());
  EXPECT_EQ(job.progress().tiles_done, 5u);
  EXPECT_EQ(job.image().samples, 0u) << "only finished passes";
  EXPECT_EQ(job.tile(tasks[0].tile).samples, 1u) << "the unfinished pass, too";
  EXPECT_TRUE(job.run(tasks[5], never));
  EXPECT_EQ(job.image().samples, 1u);
  EXPECT_EQ(next_tile_task(job).value().pass, 1u);
}

TEST(RenderJob, Progress) {
  RenderJob job(function_integrator(constant(1)), small_settings(40, 24, 16));
  EXPECT_EQ(job.progress().pass_count, 9u);
  EXPECT_EQ(job.progress().samples_planned, 40u * 24 * 16);
  run_pass(job);
  run_pass(job);
  EXPECT_EQ(job.progress().passes_done, 2u);
  EXPECT_EQ(job.progress().samples_per_pixel, 2u);
  EXPECT_EQ(job.progress().samples_done, 40u * 24 * 2);
  const TileTask task = next_tile_task(job).value();
  EXPECT_FALSE(job.run(task, never));
  const auto pixels = static_cast<uint64_t>(task.window.width * task.window.height);
  EXPECT_EQ(job.progress().samples_done, 40u * 24 * 2 + 2 * pixels);
  run_to_completion(job, 1);
  const Progress progress = job.progress();
  EXPECT_TRUE(progress.finished);
  EXPECT_TRUE(job.ended());
  EXPECT_EQ(progress.passes_done, 9u);
  EXPECT_EQ(progress.samples_done, progress.samples_planned);
  EXPECT_EQ(progress.rays, 40u * 24 * 16);
  EXPECT_EQ(progress.invalid_samples, 0u);
  EXPECT_GT(progress.cpu_seconds, 0.0);
  EXPECT_GE(progress.render_seconds, 0.0);
  EXPECT_FALSE(job.next_task().has_value());
}

TEST(RenderJob, AStoppedTaskIsHandedOutAgain) {
  std::atomic<bool> stop = false;
  int samples = 0;
  RenderJob job(function_integrator([&](const Ray&, RandomStream&, RayCounters&) {
                  if (++samples == 50) stop = true;  // of 256
                  return Spectrum(1);
                }),
                small_settings(16, 16, 1));
  const TileTask task = next_tile_task(job).value();
  EXPECT_FALSE(job.run(task, stop));
  EXPECT_LT(samples, 50 + 16);
  EXPECT_EQ(job.tile(0).pass, 0u) << "film unchanged";
  const TileTask again = next_tile_task(job).value();
  EXPECT_EQ(again.tile, task.tile);
  EXPECT_TRUE(job.run(again, stop = false));
  run_to_completion(job, 1);
  EXPECT_TRUE(job.progress().finished);
  EXPECT_EQ(job.image().rgb, std::vector<float>(16 * 16 * 3, 1.0f));
}

TEST(RenderJob, ATaskThatWasRunTwiceCountsOnce) {
  RenderJob job(function_integrator(ray_and_random_function), small_settings(32, 16, 1));
  const TileTask task = next_tile_task(job).value();
  EXPECT_FALSE(job.run(task, never));
  const TilePixels before = job.tile(task.tile);
  EXPECT_FALSE(job.run(task, never));
  EXPECT_EQ(job.tile(task.tile).rgb, before.rgb);
  EXPECT_EQ(job.progress().tiles_done, 1u);
  EXPECT_THROW(job.run(TileTask{task.tile, 3, task.window, 4, 4, 0}, never), Error);
}

TEST(RenderJob, AnExceptionOfTheIntegratorLeavesTheFilmUnchanged) {
  bool fail = true;
  RenderJob job(function_integrator([&](const Ray&, RandomStream&, RayCounters&) -> Spectrum {
                  if (fail) throw std::runtime_error("out of fog");
                  return Spectrum(1);
                }),
                small_settings(16, 16, 1));
  EXPECT_THROW(job.run(next_tile_task(job).value(), never), std::runtime_error);
  EXPECT_EQ(job.tile(0).pass, 0u);
  fail = false;
  run_to_completion(job, 1);
  EXPECT_TRUE(job.progress().finished);

  RenderJob failing(function_integrator([](const Ray&, RandomStream&, RayCounters&) -> Spectrum {
                      throw std::runtime_error("out of fog");
                    }),
                    small_settings(64, 64, 1));
  EXPECT_THROW(run_to_completion(failing, 3), std::runtime_error);
}

TEST(RenderJob, CancelBetweenTasksFallsBackToTheLastPass) {
  RenderJob job(function_integrator(ray_and_random_function), small_settings(48, 32, 16));
  run_pass(job);
  run_pass(job);
  const Image before = job.image();
  const TileTask task = next_tile_task(job).value();
  const TileTask other = next_tile_task(job).value();
  EXPECT_FALSE(job.run(task, never));
  EXPECT_EQ(job.tile(task.tile).pass, 3u);
  EXPECT_EQ(job.image().rgb, before.rgb);

  job.cancel();
  EXPECT_TRUE(job.ended());
  EXPECT_FALSE(job.progress().finished);
  EXPECT_FALSE(job.next_task().has_value());
  EXPECT_FALSE(job.run(other, never));
  EXPECT_EQ(job.tile(task.tile).pass, 2u);
  EXPECT_EQ(job.image().rgb, before.rgb);
  EXPECT_EQ(job.progress().samples_done, 48u * 32 * 2);
  const double seconds = job.progress().render_seconds;
  EXPECT_EQ(job.progress().render_seconds, seconds) << "stands still";
}

TEST(RenderJob, CancelReachesRunningTasks) {
  std::atomic<bool> begun = false;
  RenderJob job(function_integrator([&](const Ray&, RandomStream&, RayCounters&) {
                  begun = true;
                  std::this_thread::sleep_for(std::chrono::milliseconds(1));
                  return Spectrum(1);
                }),
                small_settings(1024, 1024, 1 << 20));  // weeks, if it weren't cancelled
  std::jthread crew([&] { run_to_completion(job, 2); });
  while (!begun) std::this_thread::yield();
  job.cancel();
  crew.join();
  EXPECT_EQ(job.progress().passes_done, 0u);
  EXPECT_EQ(job.image().samples, 0u);
}

TEST(RenderJob, CancelAfterTheEndChangesNothing) {
  RenderJob job(function_integrator(constant(1)), small_settings(16, 16, 1));
  run_to_completion(job, 1);
  job.cancel();
  EXPECT_TRUE(job.progress().finished);
}

TEST(RenderJob, TheFirstPassIsFinishedWhateverTheBudget) {
  RenderSettings settings = small_settings(48, 32, 1 << 20);
  settings.time_budget_seconds = 1e-9;
  RenderJob job(function_integrator(ray_and_random_function), settings);
  EXPECT_EQ(job.progress().pass_count, 0u) << "open";
  run_to_completion(job, 2);
  const Progress progress = job.progress();
  EXPECT_TRUE(progress.finished);
  EXPECT_EQ(progress.passes_done, 1u);
  EXPECT_EQ(progress.pass_count, 1u);
  EXPECT_EQ(progress.samples_planned, 48u * 32);
  settings.time_budget_seconds = 0;
  settings.samples_per_pixel = 1;
  EXPECT_EQ(job.image().rgb, render_function(settings, 1).rgb) << "the same as one sample without a budget";
}

TEST(RenderJob, AllSamplesWithinALongBudget) {
  RenderSettings settings = small_settings(48, 32, 16);
  const Image without = render_function(settings, 1);
  settings.time_budget_seconds = 3600;
  EXPECT_EQ(render_function(settings, 2).rgb, without.rgb);
}

TEST(RenderJob, APassThatOutlivesTheBudgetIsDropped) {
  RenderSettings settings = small_settings(48, 32, 1 << 20);
  settings.time_budget_seconds = 0.5;
  std::atomic<int> samples = 0;
  RenderJob job(function_integrator([&](const Ray&, RandomStream& random, RayCounters&) {
                  // The first tile of the second pass is in time, all else waits until it is not. Should the
                  // machine be so slow that the first pass takes all the budget, the outcome is the same.
                  if (samples++ == 48 * 32 + 16 * 16)
                    std::this_thread::sleep_for(std::chrono::milliseconds(600));
                  return Spectrum(random.next_float());
                }),
                settings);
  run_to_completion(job, 1);
  EXPECT_TRUE(job.progress().finished);
  EXPECT_EQ(job.progress().passes_done, 1u);
  for (uint32_t tile = 0; tile < job.tile_count(); ++tile) EXPECT_EQ(job.tile(tile).samples, 1u);
  EXPECT_EQ(job.image().samples, 1u);
}

// While two threads render, a third one reads: every tile and image is one that a whole number of passes
// makes.
TEST(RenderJob, NothingIsEverTorn) {
  const RenderSettings settings = small_settings(32, 32, 256);
  std::vector<std::vector<std::vector<float>>> tiles_after;  // [passes][tile]
  std::map<uint32_t, std::vector<float>> image_with;         // by samples
  RenderJob reference(function_integrator(ray_and_random_function), settings);
  for (;;) {
    auto& tiles = tiles_after.emplace_back();
    for (uint32_t tile = 0; tile < reference.tile_count(); ++tile) tiles.push_back(reference.tile(tile).rgb);
    image_with[reference.image().samples] = reference.image().rgb;
    if (reference.image().samples == 256) break;
    run_pass(reference);
  }

  RenderJob job(function_integrator(ray_and_random_function), settings);
  std::jthread crew([&] { run_to_completion(job, 2); });
  for (bool last = false; !last;) {
    last = job.ended();
    for (uint32_t index = 0; index < job.tile_count(); ++index) {
      const TilePixels tile = job.tile(index);
      ASSERT_EQ(tile.rgb, tiles_after.at(tile.pass).at(index));
    }
    const Image image = job.image();
    ASSERT_EQ(image.rgb, image_with.at(image.samples));
  }
}

}  // namespace
}  // namespace fogbank::render
