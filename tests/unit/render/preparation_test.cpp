// Jobs of integrators that prepare a cache: stages, layers of the film, targets, budgets.
#include <gtest/gtest.h>

#include <chrono>
#include <cmath>
#include <stdexcept>
#include <thread>

#include "core/error.h"
#include "prepared_integrator.h"
#include "render/film_camera.h"
#include "render/progression.h"

namespace fogbank::render {
namespace {

/// What a job came to, and how.
struct Outcome {
  Image image;
  Progress progress;
  std::vector<HistoryEntry> history;
};

Outcome render_prepared(const RenderSettings& settings, int threads, PreparationScript& script) {
  RenderJob job(prepared_integrator(script), settings);
  run_to_completion(job, threads);
  EXPECT_FALSE(script.overlapped);
  return {job.image(), job.progress(), job.history()};
}

TEST(Preparation, SameBitsForThreadsTilesAndOrder) {
  for (const double error : {0.0, 0.1}) {
    RenderSettings settings = small_settings(45, 37, error > 0 ? 4096 : 9);
    settings.error = error;
    settings.aovs = {Aov::bias, Aov::radius};
    PreparationScript script;
    script.noisy_cache = true;
    const Outcome one = render_prepared(settings, 1, script);
    const auto expect_same = [&](int threads) {
      PreparationScript other;
      other.noisy_cache = true;
      const Outcome outcome = render_prepared(settings, threads, other);
      EXPECT_EQ(outcome.image.samples, one.image.samples);
      EXPECT_EQ(outcome.image.rgb, one.image.rgb);
      EXPECT_EQ(outcome.image.variance, one.image.variance);
      EXPECT_EQ(outcome.progress.stage, one.progress.stage);
      ASSERT_EQ(outcome.image.aovs.size(), 2u);
      EXPECT_EQ(outcome.image.aovs[1].values, one.image.aovs[1].values);
    };
    expect_same(2);
    expect_same(7);
    settings.tile_size = 128;
    settings.tile_order = TileOrder::scan;
    expect_same(2);
    settings.tile_size = 8;
    expect_same(3);
  }
}

TEST(Preparation, PreviewFirstThenFinerAsLongAsNoiseIsLess) {
  PreparationScript script;
  script.bias_per_error = 2;
  const Outcome outcome = render_prepared(small_settings(32, 32, 64), 2, script);
  ASSERT_GE(script.targets.size(), 2u);
  EXPECT_TRUE(script.targets[0].preview);
  for (size_t i = 1; i < script.targets.size(); ++i) {
    EXPECT_FALSE(script.targets[i].preview);
    EXPECT_EQ(script.targets[i].error, 0.5 * script.targets[i - 1].error);
  }
  // A uniform number has 0.58 of relative noise, 64 of them 0.07; of L + L / 10, and a part of L has none.
  EXPECT_LT(outcome.progress.estimate.bias, 0.08);
  EXPECT_EQ(outcome.history.front().samples, 1u) << "the preview is seen";
  EXPECT_EQ(outcome.history.front().epoch, 1u);
  const auto stages = static_cast<uint32_t>(script.targets.size());
  EXPECT_EQ(outcome.progress.epoch, stages);
  EXPECT_EQ(outcome.progress.samples_per_pixel, 64u);
  EXPECT_EQ(outcome.progress.records_reused, 7u);
  EXPECT_EQ(outcome.progress.records_new, stages * 3 * 5);
  EXPECT_EQ(outcome.history.back().records, 7u + stages * 15);
  EXPECT_EQ(outcome.progress.preparation_fraction, 1.0);

  for (const int32_t samples : {1, 8}) {
    PreparationScript good;
    render_prepared(small_settings(32, 32, samples), 1, good);
    EXPECT_EQ(good.targets.size(), 1u) << "noise hides what the preview has wrong";
  }
}

// The sampled layer keeps all samples, the cached one those of the last stage.
TEST(Preparation, LayersAddUp) {
  PreparationScript script;
  RenderSettings settings = small_settings(24, 16, 8);
  // Less than the preview's bias, and than what 8 samples come to.
  settings.error = 0.05;
  const Image image = render_prepared(settings, 2, script).image;
  // The same numbers again. The cached part has no noise but that of the ray; its value is that of the second
  // stage.
  const PreparationScript again;
  const scene::Window window = settings.film.crop;
  float published = 0;
  for (uint32_t round = 1; round <= again.rounds; ++round) {
    float sum = published;
    for (uint32_t task = 0; task < again.tasks; ++task) {
      RandomStream random(0, task, round, 0);
      sum += random.next_float() + 0.1f * published;
    }
    published = sum;
  }
  published /= 100;
  for (int32_t y = 0; y < window.height; ++y) {
    for (int32_t x = 0; x < window.width; ++x) {
      Vec3d sampled(0);
      Vec3d cached(0);
      for (uint32_t i = 0; i < 8; ++i) {
        RandomStream random(0, static_cast<uint32_t>(x), static_cast<uint32_t>(y), i);
        const Ray ray = FilmCamera(settings.sensor, settings.film)
                            .sample(static_cast<uint32_t>(x), static_cast<uint32_t>(y), random);
        sampled += Vec3d(Spectrum(random.next_float()));
        // Once it has been seen to have no noise to speak of, no sample looks at the cache.
        if (i > 0 && i < 5) cached += Vec3d(Spectrum(published) + 0.25f * glm::abs(ray.direction));
      }
      const Vec3d expected = sampled / 8.0 + cached / 4.0;
      const size_t first = (static_cast<size_t>(y) * 24 + static_cast<size_t>(x)) * 3;
      // The order of summation is not promised here: a few units of the last place of floats.
      for (int c = 0; c < 3; ++c) EXPECT_NEAR(image.rgb[first + static_cast<size_t>(c)], expected[c], 1e-6);
    }
  }
}

// Samples of both layers are correlated; the variance must be that of the sum.
TEST(Preparation, VarianceOfBothLayers) {
  PreparationScript script;
  script.noisy_cache = true;
  constexpr int32_t side = 128;
  const Image image = render_prepared(small_settings(side, side, 17), 2, script).image;
  double mean = 0;
  double mean_square = 0;
  double estimate = 0;
  for (size_t i = 1; i < image.rgb.size(); i += 3) {
    const auto value = static_cast<double>(image.rgb[i]);
    mean += value / (side * side);
    mean_square += value * value / (side * side);
    estimate += static_cast<double>(image.variance[i]) / (side * side);
  }
  // All pixels have the same distribution but for the direction, whose y changes the mean by less than 1e-2
  // of the noise's variance. Relative deviation of a variance over n pixels: sqrt(2 / n), of both 4.42
  // sigmas.
  EXPECT_NEAR(estimate, mean_square - mean * mean, 4.42 * 2 * std::sqrt(2.0 / (side * side)) * estimate);
}

TEST(Preparation, ErrorTargetMakesStagesFiner) {
  RenderSettings settings = small_settings(64, 64, 1 << 14);
  settings.error = 0.02;
  PreparationScript script;
  script.bias_per_error = 3;  // far more than asked for: the estimate must be looked at
  const Outcome outcome = render_prepared(settings, 2, script);
  ASSERT_TRUE(outcome.progress.estimate.error.has_value());
  EXPECT_LE(*outcome.progress.estimate.error, 0.02);
  EXPECT_GT(*outcome.progress.estimate.error, 0.01) << "no more than was asked for";
  EXPECT_LT(outcome.progress.samples_per_pixel, 1u << 14);
  for (size_t i = 1; i < script.targets.size(); ++i) {
    EXPECT_LT(script.targets[i].error, script.targets[i - 1].error);
  }
  EXPECT_GT(outcome.progress.estimate.bias, 0.0);
  EXPECT_NEAR(*outcome.progress.estimate.error,
              std::hypot(*outcome.progress.estimate.noise, outcome.progress.estimate.bias), 1e-12);
  for (size_t i = 1; i < outcome.history.size(); ++i) {
    EXPECT_GE(outcome.history[i].samples, outcome.history[i - 1].samples);
    EXPECT_GE(outcome.history[i].cpu_seconds, outcome.history[i - 1].cpu_seconds);
    EXPECT_GE(outcome.history[i].epoch, outcome.history[i - 1].epoch);
  }
}

TEST(Preparation, AnErrorThatCannotBeReachedEnds) {
  RenderSettings settings = small_settings(32, 32, 1 << 14);
  settings.error = 0.05;
  settings.integrator_settings.most_records = 20;  // stages have 15 each
  PreparationScript script;
  script.bias_per_error = 10;
  const Outcome outcome = render_prepared(settings, 2, script);
  EXPECT_EQ(script.targets.size(), 2u);
  EXPECT_GT(*outcome.progress.estimate.error, 0.05);
  EXPECT_LT(outcome.progress.samples_per_pixel, 1u << 14) << "no samples in vain";
}

TEST(Preparation, ErrorTargetWithoutACache) {
  RenderSettings settings = small_settings(64, 64, 1 << 14);
  settings.error = 0.05;
  RenderJob job(function_integrator([](const Ray&, RandomStream& random, RayCounters&) {
                  return Spectrum(random.next_float());
                }),
                settings);
  run_to_completion(job, 2);
  // sqrt(1 / 12 / n) / 0.55 = 0.05 at n = 110; looks are a quarter of the samples apart.
  EXPECT_GE(job.progress().samples_per_pixel, 100u);
  EXPECT_LE(job.progress().samples_per_pixel, 150u);
  EXPECT_EQ(job.progress().stage, 0u);
}

TEST(Preparation, RecordBudget) {
  RenderSettings settings = small_settings(32, 32, 64);
  settings.record_budget = 70;  // stages have 15 each
  PreparationScript script;
  const Outcome outcome = render_prepared(settings, 2, script);
  EXPECT_EQ(script.targets.size(), 5u);
  EXPECT_EQ(outcome.progress.samples_per_pixel, 64u);
}

TEST(Preparation, WhoOnlyReadsRecordsReadsThemAtThePicturesOwnError) {
  RenderSettings settings = small_settings(32, 32, 64);
  settings.integrator_settings.most_records = 0;
  PreparationScript script;
  render_prepared(settings, 2, script);
  ASSERT_EQ(script.targets.size(), 1u);
  EXPECT_EQ(script.targets.front().error, cache_error(settings));
}

TEST(Preparation, CancelReachesRunningTasks) {
  std::atomic<int> waiting = 0;
  PreparationScript script;
  script.in_task = [&](uint32_t task, RayCounters& counters) {
    if (task != 7) return;
    for (++waiting;; std::this_thread::sleep_for(std::chrono::milliseconds(1))) counters.poll();
  };
  RenderJob job(prepared_integrator(script), small_settings(32, 32, 8));
  std::jthread crew([&] { run_to_completion(job, 2); });
  while (waiting == 0) std::this_thread::yield();
  EXPECT_TRUE(job.progress().preparing);
  EXPECT_NEAR(job.progress().preparation_fraction, 1.0 / 3, 1e-12);
  job.cancel();
  crew.join();
  EXPECT_FALSE(job.progress().finished);
  EXPECT_EQ(job.image().samples, 0u);
  EXPECT_FALSE(job.next_task().has_value());
}

TEST(Preparation, AStoppedTaskIsHandedOutAgain) {
  std::atomic<bool> stop = false;
  PreparationScript script;
  script.in_task = [&](uint32_t task, RayCounters& counters) {
    if (task == 3 && !stop.exchange(true)) counters.poll();
  };
  RenderJob job(prepared_integrator(script), small_settings(32, 32, 8));
  bool stopped = false;
  for (int i = 0; i < 8 && !stopped; ++i) {
    const Task task = job.next_task().value();
    job.run(task, stop);
    stopped = stop;
    EXPECT_LE(script.tasks_done, 3u);
  }
  ASSERT_TRUE(stopped);
  run_to_completion(job, 2);
  EXPECT_TRUE(job.progress().finished);
  EXPECT_FALSE(script.overlapped);
  PreparationScript unhindered;
  EXPECT_EQ(job.image().rgb, render_prepared(small_settings(32, 32, 8), 1, unhindered).image.rgb);
}

TEST(Preparation, AnExceptionOfATaskReachesTheCaller) {
  PreparationScript script;
  script.in_task = [](uint32_t task, RayCounters&) {
    if (task == 4) throw std::runtime_error("out of fog");
  };
  RenderJob job(prepared_integrator(script), small_settings(32, 32, 8));
  EXPECT_THROW(run_to_completion(job, 3), std::runtime_error);
}

TEST(Preparation, ALongOneIsDroppedForATimeBudget) {
  RenderSettings settings = small_settings(32, 32, 1 << 20);
  settings.time_budget_seconds = 0.1;
  PreparationScript script;
  script.rounds = 1 << 20;
  script.in_task = [](uint32_t, RayCounters&) { std::this_thread::sleep_for(std::chrono::milliseconds(1)); };
  const Outcome outcome = render_prepared(settings, 2, script);
  EXPECT_TRUE(outcome.progress.finished);
  EXPECT_EQ(script.stages_done, 0u);
  EXPECT_GE(outcome.progress.samples_per_pixel, 1u) << "a picture, whatever the budget";
}

TEST(Preparation, TheLastFinishedStageCounts) {
  RenderSettings settings = small_settings(32, 32, 1 << 20);
  settings.time_budget_seconds = 0.4;
  settings.aovs = {Aov::record_density};
  PreparationScript script;
  script.bias_per_error = 10;  // always too much
  script.in_task = [&](uint32_t task, RayCounters& counters) {
    // Two stages are quick; a third one would take for ever.
    if (script.stages_done < 2 || task == 0) return;
    for (;; std::this_thread::sleep_for(std::chrono::milliseconds(1))) counters.poll();
  };
  const Outcome outcome = render_prepared(settings, 2, script);
  EXPECT_TRUE(outcome.progress.finished);
  EXPECT_LE(script.stages_done, 2u);
  EXPECT_GE(outcome.history.size(), 1u);
  EXPECT_EQ(outcome.history.back().samples, outcome.image.samples);
  ASSERT_EQ(outcome.image.aovs.size(), 1u);
  EXPECT_EQ(outcome.image.aovs[0].name, "cache.record-density");
  EXPECT_EQ(outcome.image.aovs[0].values, std::vector<float>(32 * 32, 3.0f));
}

TEST(Preparation, AovsOfAnIntegratorWithoutACacheAreZero) {
  RenderSettings settings = small_settings(20, 12, 2);
  settings.aovs = {Aov::radius, Aov::variance};
  RenderJob job(function_integrator(ray_and_random_function), settings);
  run_to_completion(job, 2);
  ASSERT_EQ(job.image().aovs.size(), 2u);
  EXPECT_EQ(job.image().aovs[0].values, std::vector<float>(20 * 12));
}

TEST(Aovs, Names) {
  for (const char* name : {"radius", "record-density", "rejected", "variance", "bias"}) {
    EXPECT_EQ(name_of(parse_aov(name)), name);
  }
  try {
    parse_aov("depth");
    FAIL();
  } catch (const Error& error) {
    EXPECT_NE(std::string(error.what()).find("record-density"), std::string::npos) << "names the known ones";
  }
}

TEST(History, IsBounded) {
  RenderSettings settings = small_settings(16, 16, 1400);
  settings.tile_size = 128;  // for tiles of that size a pass has 4 samples
  RenderJob job(function_integrator([](const Ray&, RandomStream&, RayCounters&) { return Spectrum(1); }),
                settings);
  run_to_completion(job, 2);
  EXPECT_GT(job.progress().passes_done, 256u);
  EXPECT_LE(job.history().size(), 256u);
  EXPECT_EQ(job.history().back().samples, 1400u);
}

}  // namespace
}  // namespace fogbank::render
