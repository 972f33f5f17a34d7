// A job that goes on from a file gives the image that it would have given, bit for bit; a file that was
// damaged in any way is refused.
#include "render/checkpoint.h"

#include <gtest/gtest.h>

#include <cstring>
#include <filesystem>
#include <fstream>

#include "core/error.h"
#include "core/files.h"
#include "function_integrator.h"
#include "render/render_job.h"

namespace fogbank::render {
namespace {

namespace fs = std::filesystem;

const std::atomic<bool> never = false;
const std::string identity = "scene, settings and build";

class CheckpointFile : public ::testing::Test {
 protected:
  CheckpointFile() : folder_(fs::temp_directory_path() / ("checkpoint_test." + std::to_string(::getpid()))) {
    fs::create_directories(folder_);
  }
  ~CheckpointFile() override { fs::remove_all(folder_); }

  fs::path path() const { return folder_ / "checkpoint"; }
  /// A job after so many passes, in the file.
  Checkpoint save(const RenderSettings& settings, uint32_t passes) const {
    RenderJob job(function_integrator(ray_and_random_function), settings);
    while (job.progress().passes_done < passes) job.run(job.next_task().value(), never);
    Checkpoint checkpoint = job.checkpoint().value();
    write_checkpoint(path(), checkpoint, identity);
    return checkpoint;
  }
  Image go_on(const RenderSettings& settings) const {
    RenderJob job(function_integrator(ray_and_random_function), settings);
    job.resume(read_checkpoint(path(), identity));
    run_to_completion(job, 2);
    return job.image();
  }
  void write(const std::string& bytes) const { std::ofstream(path(), std::ios::binary) << bytes; }
  bool is_refused() const {
    try {
      read_checkpoint(path(), identity);
      return false;
    } catch (const Error& error) {
      return error.reason() == "CHECKPOINT_DAMAGED";
    }
  }

 private:
  fs::path folder_;
};

bool same_bits(const std::vector<float>& a, const std::vector<float>& b) {
  return a.size() == b.size() && std::memcmp(a.data(), b.data(), a.size() * sizeof(float)) == 0;
}

TEST_F(CheckpointFile, AResumedJobGivesTheSameImage) {
  const RenderSettings settings = small_settings(83, 57, 40);
  const Image whole = render_function(settings, 2);
  for (const uint32_t passes : {1u, 2u, 5u}) {
    const Checkpoint saved = save(settings, passes);
    EXPECT_EQ(saved.passes, passes);
    EXPECT_GT(saved.rays, 0u);
    const Image resumed = go_on(settings);
    EXPECT_EQ(resumed.samples, 40u);
    EXPECT_TRUE(same_bits(resumed.rgb, whole.rgb));
    EXPECT_TRUE(same_bits(resumed.variance, whole.variance));
  }
}

TEST_F(CheckpointFile, ATileMayBeEmpty) {
  Checkpoint checkpoint;
  checkpoint.tiles = {std::make_shared<TileFilm>()};
  write_checkpoint(path(), checkpoint, identity);
  const Checkpoint read = read_checkpoint(path(), identity);
  ASSERT_EQ(read.tiles.size(), 1u);
  EXPECT_TRUE(read.tiles[0]->sampled.empty());
}

TEST_F(CheckpointFile, AnErrorTargetIsMetAtTheSameSample) {
  RenderSettings settings = small_settings(40, 24, 4096);
  settings.error = 0.05;
  const Image whole = render_function(settings, 1);
  EXPECT_GT(whole.samples, 8u);
  EXPECT_LT(whole.samples, 4096u);
  for (const uint32_t passes : {1u, 4u, 7u}) {
    save(settings, passes);
    const Image resumed = go_on(settings);
    EXPECT_EQ(resumed.samples, whole.samples);
    EXPECT_TRUE(same_bits(resumed.rgb, whole.rgb));
  }
}

TEST_F(CheckpointFile, KeepsWhatTheJobTellsOfItself) {
  const RenderSettings settings = small_settings(40, 24, 64);
  const Checkpoint saved = save(settings, 4);
  RenderJob job(function_integrator(ray_and_random_function), settings);
  job.resume(read_checkpoint(path(), identity));
  const Progress progress = job.progress();
  EXPECT_EQ(progress.passes_done, 4u);
  EXPECT_EQ(progress.samples_per_pixel, saved.samples);
  EXPECT_EQ(progress.rays, saved.rays);
  EXPECT_GE(progress.render_seconds, saved.render_seconds);
  EXPECT_EQ(job.tile(0).pass, 4u);
  run_to_completion(job, 1);
  std::vector<uint32_t> samples;
  for (const HistoryEntry& entry : job.history()) samples.push_back(entry.samples);
  EXPECT_EQ(samples, (std::vector<uint32_t>{1, 2, 4, 8, 16, 24, 32, 40, 48, 56, 64}));
}

TEST_F(CheckpointFile, EveryFlippedBitAndEveryCutIsFound) {
  save(small_settings(2, 2, 4), 2);
  const std::string good = read_file(path(), 1 << 20);
  ASSERT_FALSE(is_refused());
  for (size_t byte = 0; byte < good.size(); ++byte) {
    std::string bad = good;
    bad[byte] = static_cast<char>(bad[byte] ^ (1 << byte % 8));
    write(bad);
    ASSERT_TRUE(is_refused()) << "byte " << byte;
    write(good.substr(0, byte));
    ASSERT_TRUE(is_refused()) << "cut at " << byte;
  }
  write(good + "x");
  EXPECT_TRUE(is_refused());
}

TEST_F(CheckpointFile, IsForOneJobAlone) {
  const RenderSettings settings = small_settings(40, 24, 64);
  const Checkpoint saved = save(settings, 4);
  EXPECT_THROW(read_checkpoint(path(), "another"), Error);
  for (const RenderSettings& other :
       {small_settings(24, 40, 64), small_settings(40, 25, 64), small_settings(40, 24, 2)}) {
    RenderJob job(function_integrator(ray_and_random_function), other);
    EXPECT_THROW(job.resume(saved), Error);
    EXPECT_EQ(job.progress().passes_done, 0u);
  }
}

TEST_F(CheckpointFile, ThereIsNoneBeforeTheFirstPass) {
  const RenderJob job(function_integrator(ray_and_random_function), small_settings(40, 24, 4));
  EXPECT_FALSE(job.checkpoint());
}

}  // namespace
}  // namespace fogbank::render
