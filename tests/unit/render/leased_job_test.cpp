// A job whose tasks replicas perform comes to the bits of the job that one process runs: image and records.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstring>
#include <limits>
#include <random>
#include <thread>

#include "cache/record_bytes.h"
#include "cache/scene_cache.h"
#include "core/error.h"
#include "foggy_room.h"
#include "render/render_job.h"
#include "render/render_to_image.h"
#include "render/replica.h"
#include "scene/intersector.h"
#include "transport/world_builders.h"

namespace fogbank::render {
namespace {

const std::atomic<bool> never = false;

std::shared_ptr<const transport::World> thin_fog() {
  static const auto world = transport::test::parse_world(foggy_room("0.5, 0.6, 0.7", "0.8"));
  return world;
}

RenderSettings settings_of(const transport::World& world, const std::string& integrator) {
  RenderSettings settings;
  settings.integrator = integrator;
  settings.film.width = 20;
  settings.film.height = 14;
  settings.film.crop = {1, 2, 18, 11};
  settings.sensor = world.scene().sensor;
  settings.samples_per_pixel = 6;
  settings.tile_size = 8;
  settings.seed = 3;
  // Every replica traces the photons of every pass.
  if (integrator == "photon-beams") settings.samples_per_pixel = 2;
  if (integrator == "radiance-cache") {
    settings.integrator_settings.cache = std::make_shared<cache::SceneCache>();
    settings.error = 0.2;
    settings.samples_per_pixel = 16;
    settings.aovs = {Aov::radius, Aov::bias};
  }
  return settings;
}

std::string bytes_of_records(const RenderSettings& settings) {
  std::string bytes;
  if (!settings.integrator_settings.cache) return bytes;
  const auto set = settings.integrator_settings.cache->records();
  for (size_t i = 0; i < set->size(); ++i) cache::append_record(bytes, set->record(i));
  return bytes;
}

template <typename T>
bool same_bits(const std::vector<T>& a, const std::vector<T>& b) {
  return a.size() == b.size() && std::memcmp(a.data(), b.data(), a.size() * sizeof(T)) == 0;
}

void expect_same(const Image& a, const Image& b) {
  EXPECT_EQ(a.samples, b.samples);
  EXPECT_TRUE(same_bits(a.rgb, b.rgb));
  EXPECT_TRUE(same_bits(a.variance, b.variance));
  ASSERT_EQ(a.aovs.size(), b.aovs.size());
  for (size_t i = 0; i < a.aovs.size(); ++i) EXPECT_TRUE(same_bits(a.aovs[i].values, b.aovs[i].values));
}

/// Replays what the replica hasn't yet.
void follow(Replica& replica, const RenderJob& job) {
  for (uint64_t entry = replica.log_length(); entry < job.log().length(); ++entry)
    replica.advance(entry, job.log().entry(entry)->data);
}

bool refuses(RenderJob& job, const LeasedTask& task, const TaskResult& result) {
  try {
    job.complete(task.stage, task.index, result);
  } catch (const Error& error) {
    return error.reason() == "POISONED_RESULT";
  }
  return false;
}

/// Tasks in random order on random replicas, some of them twice and late, some poisoned at first; a replica
/// is now and then thrown away, and its successor replays the log.
class RandomFarm {
 public:
  RandomFarm(RenderJob& job, std::shared_ptr<const transport::World> world, uint32_t replicas,
             uint32_t losses)
      : job_(job), world_(std::move(world)), replicas_(replicas), random_(replicas), losses_left_(losses) {}

  void run() {
    while (!job_.ended()) {
      if (const std::optional<Task> own = job_.next_task()) {
        job_.run(*own, never);
        if (std::holds_alternative<PlanTask>(*own)) {
          leased_.clear();
        } else {
          ++own_tasks_;
        }
        continue;
      }
      while (std::optional<LeasedTask> task = job_.lease()) leased_.push_back(std::move(*task));
      ASSERT_FALSE(leased_.empty()) << "the job neither plans nor has tasks";
      if (below(20) == 0) {
        job_.recall_leases();
        leased_.clear();
        continue;
      }
      perform_one();
    }
  }

  uint32_t stages() const { return stages_; }
  uint32_t own_tasks() const { return own_tasks_; }
  uint32_t performed() const { return performed_; }

 private:
  uint32_t below(uint32_t end) { return static_cast<uint32_t>(random_() % end); }

  Replica& some_replica() {
    std::unique_ptr<Replica>& replica = replicas_[below(static_cast<uint32_t>(replicas_.size()))];
    const bool lost = losses_left_ > 0 && below(40) == 0;
    if (lost) --losses_left_;
    if (!replica || lost) replica = std::make_unique<Replica>(world_, job_.settings());
    follow(*replica, job_);
    return *replica;
  }

  void perform_one() {
    const auto at = leased_.begin() + below(static_cast<uint32_t>(leased_.size()));
    const LeasedTask task = std::move(*at);
    leased_.erase(at);
    stages_ = std::max(stages_, task.stage);
    const std::optional<TaskResult> result = some_replica().perform(task, never);
    ASSERT_TRUE(result);
    ++performed_;
    if (below(4) == 0) {
      TaskResult poisoned = *result;
      poisoned.bytes.resize(below(static_cast<uint32_t>(poisoned.bytes.size())));
      if (!result->bytes.empty()) {
        EXPECT_TRUE(refuses(job_, task, poisoned)) << "of " << result->bytes.size();
      }
    }
    EXPECT_NE(job_.complete(task.stage, task.index, *result), Completion::ignored);
    if (below(3) == 0) {
      EXPECT_EQ(job_.complete(task.stage, task.index, *result), Completion::ignored);
    }
    if (late_ && below(5) == 0) {
      EXPECT_EQ(job_.complete(late_->first.stage, late_->first.index, late_->second), Completion::ignored);
    }
    if (below(5) == 0) late_ = {task, *result};
  }

  RenderJob& job_;
  std::shared_ptr<const transport::World> world_;
  std::vector<std::unique_ptr<Replica>> replicas_;
  std::mt19937 random_;
  uint32_t losses_left_;
  std::vector<LeasedTask> leased_;
  std::optional<std::pair<LeasedTask, TaskResult>> late_;
  uint32_t stages_ = 0;
  uint32_t own_tasks_ = 0;
  uint32_t performed_ = 0;  ///< by replicas
};

void expect_farm_is_one_process(const std::shared_ptr<const transport::World>& world,
                                const std::string& integrator, uint32_t least_stages) {
  const RenderSettings plain = settings_of(*world, integrator);
  RenderJob job(world, plain);
  run_to_completion(job, 2);
  const Image image = job.image();
  for (const uint32_t replicas : {1u, 2u, 3u}) {
    const RenderSettings settings = settings_of(*world, integrator);
    RenderJob leased(world, settings, Performers::replicas);
    RandomFarm farm(leased, world, replicas, integrator == "photon-beams" ? replicas / 3 : 10);
    farm.run();
    SCOPED_TRACE(replicas);
    expect_same(image, leased.image());
    EXPECT_EQ(bytes_of_records(settings), bytes_of_records(plain));
    EXPECT_EQ(leased.progress().rays > 0, true);
    EXPECT_GE(farm.stages(), least_stages);
  }
}

TEST(LeasedJob, VolumePathsOnReplicas) { expect_farm_is_one_process(thin_fog(), "volpath", 3); }

TEST(LeasedJob, PhotonBeamsOnReplicas) { expect_farm_is_one_process(thin_fog(), "photon-beams", 2); }

// A preview, a finer stage with further records of noisy places, surveys, AOVs.
TEST(LeasedJob, RadianceCacheOnReplicas) { expect_farm_is_one_process(thin_fog(), "radiance-cache", 12); }

// The coordinator performs what takes it less than a trip: all, or only the cheapest stages and what it
// tries.
TEST(LeasedJob, CheapStagesOnTheCoordinator) {
  const auto world = thin_fog();
  for (const char* const integrator : {"volpath", "radiance-cache", "photon-beams"}) {
    const RenderSettings plain = settings_of(*world, integrator);
    RenderJob job(world, plain);
    run_to_completion(job, 2);
    for (const double trip : {1e-4, 1e-3, 1e6}) {
      SCOPED_TRACE(integrator + std::string(" with trips of ") + std::to_string(trip));
      const RenderSettings settings = settings_of(*world, integrator);
      RenderJob leased(world, settings, Performers::replicas);
      leased.set_trip_seconds(trip);
      RandomFarm farm(leased, world, 2, 5);
      farm.run();
      expect_same(job.image(), leased.image());
      EXPECT_EQ(bytes_of_records(settings), bytes_of_records(plain));
      // Photons are what replicas have.
      if (settings.integrator == "photon-beams") {
        EXPECT_EQ(farm.own_tasks(), 0);
      } else {
        EXPECT_GT(farm.own_tasks(), 0);
        EXPECT_EQ(farm.performed() == 0, trip > 1);
      }
    }
  }
}

/// Has the tasks that are leased now performed by `threads` threads of one replica.
std::vector<std::pair<LeasedTask, TaskResult>> perform_all(RenderJob& job, Replica& replica, int threads) {
  while (job.caller_due()) job.run(*job.next_task(), never);
  follow(replica, job);
  std::vector<LeasedTask> tasks;
  while (std::optional<LeasedTask> task = job.lease()) tasks.push_back(std::move(*task));
  std::vector<std::pair<LeasedTask, TaskResult>> results(tasks.size());
  std::atomic<size_t> next = 0;
  std::vector<std::jthread> crew;
  for (int i = 0; i < threads; ++i) {
    crew.emplace_back([&] {
      for (size_t number = next++; number < tasks.size(); number = next++)
        results[number] = {tasks[number], replica.perform(tasks[number], never).value()};
    });
  }
  crew.clear();
  return results;
}

// Threads of a replica trace the photons of a pass together; results don't depend on their number.
TEST(LeasedJob, ThreadsOfAReplica) {
  const auto world = thin_fog();
  for (const char* const integrator : {"photon-beams", "radiance-cache"}) {
    RenderJob job(world, settings_of(*world, integrator), Performers::replicas);
    Replica one(world, job.settings());
    Replica several(world, job.settings());
    const auto results = perform_all(job, one, 1);
    job.recall_leases();
    const auto others = perform_all(job, several, 3);
    ASSERT_EQ(results.size(), others.size());
    for (size_t i = 0; i < results.size(); ++i) {
      const auto same = std::ranges::find_if(
          others, [&](const auto& other) { return other.first.index == results[i].first.index; });
      ASSERT_NE(same, others.end());
      EXPECT_EQ(results[i].second.bytes, same->second.bytes);
    }
  }
}

TEST(LeasedJob, AStoppedTaskThrowsAndCanBePerformedAgain) {
  const auto world = thin_fog();
  RenderSettings settings = settings_of(*world, "volpath");
  settings.samples_per_pixel = 1 << 20;
  RenderJob job(world, settings, Performers::replicas);
  Replica replica(world, job.settings());
  // Passes grow until a tile takes long.
  for (int pass = 0; pass < 11; ++pass) {
    for (const auto& [task, result] : perform_all(job, replica, 2))
      job.complete(task.stage, task.index, result);
  }
  while (job.caller_due()) job.run(*job.next_task(), never);
  const LeasedTask task = job.lease().value();
  std::atomic<bool> stop = false;
  std::jthread stopper([&] {
    std::this_thread::sleep_for(std::chrono::milliseconds(20));
    stop = true;
  });
  EXPECT_THROW(replica.perform(task, stop), Interrupted);
  job.cancel();
  EXPECT_FALSE(job.lease());
  EXPECT_EQ(job.complete(task.stage, task.index, {}), Completion::ignored);
}

// What is left behind gives no result; what is ahead says so.
TEST(LeasedJob, ReplicasPerformThePresentStageOnly) {
  const auto world = thin_fog();
  RenderJob job(world, settings_of(*world, "radiance-cache"), Performers::replicas);
  Replica replica(world, job.settings());
  const auto first = perform_all(job, replica, 2);
  for (const auto& [task, result] : first) job.complete(task.stage, task.index, result);
  Replica late(world, job.settings());
  try {
    late.perform(first[0].first, never);
    FAIL() << "it has not even begun";
  } catch (const Error& error) {
    EXPECT_EQ(error.reason(), "REPLICA_BEHIND");
  }
  EXPECT_THROW(late.advance(1, job.log().entry(0)->data), Error);
  perform_all(job, replica, 2);
  EXPECT_FALSE(replica.perform(first[0].first, never));
  EXPECT_EQ(job.complete(first[0].first.stage, first[0].first.index, first[0].second), Completion::ignored);
}

// Bytes that are changed, cut off and added are refused with a typed error, or say something that could be.
TEST(LeasedJob, DamagedBytesAreRefused) {
  const auto world = thin_fog();
  RenderJob job(world, settings_of(*world, "radiance-cache"), Performers::replicas);
  Replica replica(world, job.settings());
  std::mt19937 random(5);  // NOLINT(bugprone-random-generator-seed): the same damage every time
  const auto mutated = [&](std::string bytes) {
    if (random() % 4 == 0) bytes.resize(random() % bytes.size());
    if (random() % 4 == 0) bytes += static_cast<char>(random());
    if (bytes.empty()) return bytes;
    for (uint32_t left = 1 + random() % 3; left > 0; --left)
      bytes[random() % std::min<size_t>(bytes.size(), left == 1 ? 48 : bytes.size())] =
          static_cast<char>(random() % 2 == 0 ? 0xff : random());
    return bytes;
  };
  const std::vector<std::string> reasons{"INVALID_TASK", "INVALID_LOG", "POISONED_RESULT", "REPLICA_BEHIND",
                                         "REPLICA_DIVERGED"};
  const auto try_to = [&](const auto& work) {
    try {
      work();
    } catch (const Error& error) {
      EXPECT_THAT(reasons, testing::Contains(error.reason()));
    }
  };
  for (int stage = 0; stage < 8; ++stage) {
    const auto results = perform_all(job, replica, 2);
    ASSERT_FALSE(results.empty());
    for (const auto& [task, result] : results) {
      for (int i = 0; i < 3; ++i) {
        try_to([&] {
          const TaskInput input = task_input(mutated(task.input));
          if (const auto* const tile = std::get_if<TileInput>(&input.what)) {
            EXPECT_LE(tile->film.sampled.size(), size_t{128} * 128);
          }
        });
      }
      job.complete(task.stage, task.index, result);
    }
    const std::string entry = job.log().entry(job.log().length() - 1)->data;
    for (int i = 0; i < 20; ++i) {
      try_to([&] { JobLogReader().read(mutated(entry)); });
    }
  }
  for (int i = 0; i < 20; ++i) {
    Replica victim(world, job.settings());
    const uint64_t damaged = random() % job.log().length();
    try_to([&] {
      for (uint64_t index = 0; index < job.log().length(); ++index) {
        const std::string& data = job.log().entry(index)->data;
        victim.advance(index, index == damaged ? mutated(data) : data);
      }
    });
  }
}

}  // namespace
}  // namespace fogbank::render
