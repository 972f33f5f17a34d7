// A job with a cache that goes on from a file, on the records that the file names, gives the image that it
// would have given, bit for bit, and does nothing twice.
#include <gtest/gtest.h>

#include <cstring>
#include <filesystem>
#include <limits>

#include "cache/scene_cache.h"
#include "core/error.h"
#include "core/files.h"
#include "foggy_room.h"
#include "render/checkpoint.h"
#include "render/render_job.h"
#include "render/render_to_image.h"
#include "transport/world_builders.h"

namespace fogbank::render {
namespace {

namespace fs = std::filesystem;
using transport::World;

const std::atomic<bool> never = false;
const std::string identity = "scene, settings and build";

bool same_bits(const std::vector<float>& a, const std::vector<float>& b) {
  return a.size() == b.size() && std::memcmp(a.data(), b.data(), a.size() * sizeof(float)) == 0;
}

void expect_same(const Image& a, const Image& b) {
  EXPECT_EQ(a.samples, b.samples);
  EXPECT_TRUE(same_bits(a.rgb, b.rgb));
  EXPECT_TRUE(same_bits(a.variance, b.variance));
  ASSERT_EQ(a.aovs.size(), b.aovs.size());
  for (size_t i = 0; i < a.aovs.size(); ++i) EXPECT_TRUE(same_bits(a.aovs[i].values, b.aovs[i].values));
}

std::shared_ptr<const World> thin_fog() {
  static const auto world = transport::test::parse_world(foggy_room("0.5, 0.6, 0.7", "0.8"));
  return world;
}

/// Where records of generation 0 would take too many rays: paths end among photons.
std::shared_ptr<const World> dense_fog() {
  static const auto world = transport::test::parse_world(foggy_room("8", "0.99"));
  return world;
}

/// In thin fog several stages, with passes between them.
RenderSettings settings_of(const World& world) {
  RenderSettings settings;
  settings.integrator = "radiance-cache";
  settings.film.width = 34;
  settings.film.height = 32;
  settings.film.crop = {0, 0, 34, 32};
  settings.sensor = world.scene().sensor;
  settings.samples_per_pixel = 24;
  settings.tile_size = 16;
  settings.error = 0.06;
  settings.aovs = {Aov::bias};
  if (&world == dense_fog().get()) {
    settings.samples_per_pixel = 12;
    settings.error = 0.2;
  }
  return settings;
}

class CachedCheckpoint : public ::testing::Test {
 protected:
  CachedCheckpoint()
      : folder_(fs::temp_directory_path() / ("cached_checkpoint_test." + std::to_string(::getpid()))) {
    fs::create_directories(folder_);
  }
  ~CachedCheckpoint() override { fs::remove_all(folder_); }

  /// Written to a file and read from it.
  Checkpoint stored(const Checkpoint& checkpoint) const {
    write_checkpoint(folder_ / "checkpoint", checkpoint, identity);
    return read_checkpoint(folder_ / "checkpoint", identity);
  }

 private:
  fs::path folder_;
};

/// A job on its way to the end, with the checkpoints that it could have left.
struct Course {
  Image image;
  Progress progress;
  std::vector<Checkpoint> checkpoints;  ///< after each pass
  std::shared_ptr<cache::SceneCache> cache;
};

Course run(const std::shared_ptr<const World>& world, RenderSettings settings) {
  Course course;
  course.cache = std::make_shared<cache::SceneCache>();
  settings.integrator_settings.cache = course.cache;
  RenderJob job(world, settings);
  while (const std::optional<Task> task = job.next_task())
    if (job.run(*task, never)) course.checkpoints.push_back(job.checkpoint().value());
  course.image = job.image();
  course.progress = job.progress();
  return course;
}

/// Goes on after `checkpoint`, with a cache that holds everything that came later, too.
std::unique_ptr<RenderJob> resumed(const std::shared_ptr<const World>& world, RenderSettings settings,
                                   const Checkpoint& checkpoint,
                                   const std::shared_ptr<cache::SceneCache>& all) {
  settings.integrator_settings.cache = cache::SceneCache::fork(all, checkpoint.stage->records);
  EXPECT_NE(settings.integrator_settings.cache, nullptr);
  auto job = std::make_unique<RenderJob>(world, settings);
  job->resume(checkpoint);
  return job;
}

/// Of all tiles that a job renders from here on.
uint32_t first_sample_rendered(RenderJob& job) {
  uint32_t first = std::numeric_limits<uint32_t>::max();
  while (const std::optional<Task> task = job.next_task()) {
    if (const auto* const tile = std::get_if<TileTask>(&*task)) first = std::min(first, tile->first_sample);
    job.run(*task, never);
  }
  return first;
}

TEST_F(CachedCheckpoint, AJobGoesOnFromAnyPassToTheSameBits) {
  for (const auto& world : {thin_fog(), dense_fog()}) {
    const RenderSettings settings = settings_of(*world);
    const Course whole = run(world, settings);
    ASSERT_GE(whole.progress.stage, world == thin_fog() ? 2u : 1u);
    ASSERT_GT(whole.checkpoints.size(), 3u);
    const auto records = whole.cache->records();
    for (const Checkpoint& then : whole.checkpoints) {
      SCOPED_TRACE(then.passes);
      const auto job = resumed(world, settings, stored(then), whole.cache);
      EXPECT_EQ(job->progress().passes_done, then.passes);
      EXPECT_EQ(job->progress().rays, then.rays);
      const bool was_last = then.samples == whole.image.samples;
      EXPECT_EQ(first_sample_rendered(*job), was_last ? std::numeric_limits<uint32_t>::max() : then.samples);
      expect_same(job->image(), whole.image);
      const Progress progress = job->progress();
      EXPECT_EQ(progress.stage, whole.progress.stage);
      EXPECT_EQ(progress.records_new, whole.progress.records_new);
      EXPECT_EQ(progress.records_reused, whole.progress.records_reused);
      EXPECT_EQ(progress.decisions.size(), whole.progress.decisions.size());
      EXPECT_EQ(progress.estimate.error, whole.progress.estimate.error);
      EXPECT_EQ(job->history().size(), whole.checkpoints.size());
    }
    // Nothing was made that wasn't there: the later stages came to the same records.
    EXPECT_EQ(whole.cache->records(), records);
  }
}

TEST_F(CachedCheckpoint, OtherSettingsGoOnToTheSameBits) {
  const auto world = thin_fog();
  RenderSettings by_samples = settings_of(*world);
  by_samples.error = 0;
  RenderSettings unaware = by_samples;
  unaware.integrator = "radiance-cache-unaware";
  RenderSettings budget = settings_of(*world);
  budget.record_budget = 100;
  RenderSettings ratios = by_samples;
  ratios.integrator_settings.single_scattering = integrators::SingleScattering::cached;
  for (const RenderSettings& settings : {by_samples, unaware, budget, ratios}) {
    const Course whole = run(world, settings);
    const Checkpoint& then = whole.checkpoints[whole.checkpoints.size() / 2];
    const auto job = resumed(world, settings, stored(then), whole.cache);
    EXPECT_EQ(first_sample_rendered(*job), then.samples);
    expect_same(job->image(), whole.image);
  }
}

TEST_F(CachedCheckpoint, WhoOnlyReadsGoesOnToTheSameBits) {
  const auto world = thin_fog();
  RenderSettings settings = settings_of(*world);
  const auto there = run(world, settings).cache;
  settings.integrator_settings.cache = there;
  settings.integrator_settings.most_records = 0;
  RenderJob job(world, settings);
  std::optional<Checkpoint> then;
  while (const std::optional<Task> task = job.next_task())
    if (job.run(*task, never) && !then) then = stored(job.checkpoint().value());
  const auto again = resumed(world, settings, then.value(), there);
  run_to_completion(*again, 2);
  expect_same(again->image(), job.image());
}

// Killed in a fill, at the worst moment: it begins again with the records that it began with, of which there
// were none. What is there is not made again, and nobody sees it before its turn.
TEST_F(CachedCheckpoint, AnInterruptedFillMakesNoRecordTwice) {
  for (const auto& world : {thin_fog(), dense_fog()}) {
    const RenderSettings settings = settings_of(*world);
    const Course whole = run(world, settings);
    RenderSettings second_life = settings;
    second_life.integrator_settings.cache = cache::SceneCache::fork(whole.cache, {});
    EXPECT_EQ(second_life.integrator_settings.cache->records()->size(), 0u);
    RenderJob job(world, second_life);
    run_to_completion(job, 2);
    expect_same(job.image(), whole.image);
    EXPECT_EQ(job.progress().records_new, whole.progress.records_new);
    EXPECT_LT(job.progress().rays, whole.progress.rays);
  }
}

// How long steps take is none of the test's business: the budget is never used up.
TEST_F(CachedCheckpoint, ATimeBudgetGoesOnWithWhatWasDone) {
  const auto world = thin_fog();
  RenderSettings settings = settings_of(*world);
  settings.error = 0;
  settings.time_budget_seconds = 1e4;
  settings.record_budget = 60;
  const Course whole = run(world, settings);
  const Checkpoint& then = whole.checkpoints.front();
  ASSERT_LT(then.samples, whole.image.samples);
  const auto job = resumed(world, settings, stored(then), whole.cache);
  EXPECT_GE(job->progress().render_seconds, then.render_seconds);
  EXPECT_EQ(first_sample_rendered(*job), then.samples);
  EXPECT_EQ(job->image().samples, whole.image.samples);
  EXPECT_TRUE(job->progress().finished);
}

TEST_F(CachedCheckpoint, WithoutItsRecordsItIsRefused) {
  const auto world = thin_fog();
  RenderSettings settings = settings_of(*world);
  const Course whole = run(world, settings);
  const Checkpoint& then = whole.checkpoints.back();
  EXPECT_EQ(cache::SceneCache::fork(std::make_shared<cache::SceneCache>(), then.stage->records), nullptr);
  std::vector<uint64_t> one_twice = then.stage->records;
  one_twice.push_back(one_twice.front());
  EXPECT_EQ(cache::SceneCache::fork(whole.cache, one_twice), nullptr);

  const auto refuses = [&](const Checkpoint& checkpoint, const std::shared_ptr<cache::SceneCache>& cache) {
    RenderSettings its = settings;
    its.integrator_settings.cache = cache;
    RenderJob job(world, its);
    EXPECT_THROW(job.resume(checkpoint), Error);
  };
  refuses(then, std::make_shared<cache::SceneCache>());
  Checkpoint without = then;
  without.stage = nullptr;
  refuses(without, whole.cache);
  for (std::string CachedStage::*const part : {&CachedStage::integrator, &CachedStage::survey}) {
    for (const size_t cut : {size_t{1}, ((*then.stage).*part).size() / 2}) {
      auto damaged = std::make_shared<CachedStage>(*then.stage);
      ((*damaged).*part).resize(((*damaged).*part).size() - cut);
      Checkpoint bad = then;
      bad.stage = damaged;
      refuses(bad, cache::SceneCache::fork(whole.cache, then.stage->records));
    }
  }
}

// The same file, read and written.
TEST_F(CachedCheckpoint, EverythingIsInTheFile) {
  const auto world = thin_fog();
  const Course whole = run(world, settings_of(*world));
  const fs::path file = fs::temp_directory_path() / ("cached_checkpoint." + std::to_string(::getpid()));
  write_checkpoint(file, whole.checkpoints.back(), identity);
  const std::string bytes = read_file(file, 1 << 24);
  write_checkpoint(file, read_checkpoint(file, identity), identity);
  EXPECT_EQ(read_file(file, 1 << 24), bytes);
  fs::remove(file);
}

TEST_F(CachedCheckpoint, ALeasedJobHasNone) {
  const auto world = thin_fog();
  RenderJob job(world, settings_of(*world), Performers::replicas);
  EXPECT_FALSE(job.checkpoint());
}

}  // namespace
}  // namespace fogbank::render
