// Points in, results out: order, threads, chunks, cancelling, failures. The estimator is a function of the
// test.
#include "render/probe_job.h"

#include <gtest/gtest.h>

#include <cstring>
#include <functional>
#include <limits>
#include <map>
#include <semaphore>
#include <string>
#include <thread>

#include "core/error.h"
#include "core/random.h"
#include "scene/loader.h"
#include "scene/memory_files.h"

namespace fogbank::render {
namespace {

using derivatives::Estimator;
using derivatives::EstimatorSettings;
using derivatives::RadianceJet;

class FunctionEstimator final : public Estimator {
 public:
  using Function = std::function<RadianceJet(const Vec3f&, uint32_t, RayCounters&)>;
  explicit FunctionEstimator(Function function) : function_(std::move(function)) {}
  RadianceJet estimate(const Vec3f& x, uint32_t repeat, RayCounters& counters) const override {
    return function_(x, repeat, counters);
  }

 private:
  Function function_;
};

/// Depends on everything that an estimate may depend on, with an amount of work that differs from point to
/// point.
RadianceJet point_and_random(const Vec3f& x, uint32_t repeat, RayCounters& counters) {
  uint32_t bits = 0;
  std::memcpy(&bits, &x.x, sizeof bits);
  RandomStream random(7, bits, 0, repeat);
  RadianceJet jet;
  const int terms = 1 + static_cast<int>(50 * random.next_float());
  for (int i = 0; i < terms; ++i) {
    for (derivatives::Jet3d& channel : jet.channels) {
      channel += derivatives::Jet3d::linear(random.next_float(), Vec3d(x) * 1e-3);
      channel.hessian(0, 2) += random.next_float();
    }
    ++counters.any_hit;
  }
  return jet;
}

/// A box of fog, 2 u wide, in a vacuum.
std::shared_ptr<const transport::World> fog_box() {
  static const auto world = [] {
    scene::prepare_render_thread();
    const std::string xml = R"(<scene version="3.0.0">
      <medium type="homogeneous" id="fog"><rgb name="sigma_t" value="1"/><rgb name="albedo" value="1"/></medium>
      <shape type="cube"><bsdf type="null"/><ref name="interior" id="fog"/></shape></scene>)";
    return std::make_shared<const transport::World>(scene::load_scene(
        "scene.xml",
        std::make_shared<scene::test::MemoryFiles>(std::map<std::string, std::string>{{"scene.xml", xml}}),
        {}));
  }();
  return world;
}

ProbeJob make_job(const EstimatorSettings& settings,
                  const FunctionEstimator::Function& function = point_and_random) {
  return {fog_box(), settings, [function] { return std::make_unique<FunctionEstimator>(function); }};
}

/// The first task makes the estimator.
void make_estimator(ProbeJob& job) { EXPECT_FALSE(job.work({})); }

constexpr auto slice = std::chrono::milliseconds(1);

std::vector<Vec3f> some_points(size_t count) {
  std::vector<Vec3f> points;
  for (size_t i = 0; i < count; ++i) {
    const auto t = static_cast<float>(i);
    points.emplace_back(0.01f * t, 0.3f, -0.02f * t);
  }
  return points;
}

/// Everything but the time, as bytes.
std::string bytes_of(const std::vector<PointResult>& results) {
  std::string bytes;
  const auto append = [&](const auto& value) {
    bytes.append(reinterpret_cast<const char*>(&value), sizeof value);
  };
  for (const PointResult& result : results) {
    append(result.estimate.mean);
    append(result.estimate.standard_error);
    append(result.estimate.luminance_standard_error);
    append(result.estimate.samples);
    append(result.medium);
  }
  return bytes;
}

std::string probe(const std::vector<Vec3f>& points, size_t chunk, int threads) {
  ProbeJob job = make_job({.repeats = 3});
  size_t sent = 0;
  size_t received = 0;
  std::string bytes;
  while (received < points.size()) {
    for (; sent < points.size() && job.points_in_flight() < 4 * chunk; sent += chunk) {
      const auto begin = points.begin() + static_cast<std::ptrdiff_t>(sent);
      job.add({begin, begin + static_cast<std::ptrdiff_t>(std::min(chunk, points.size() - sent))});
    }
    {
      std::vector<std::jthread> crew;
      for (int i = 0; i < threads; ++i) {
        crew.emplace_back([&] {
          while (job.has_work()) job.work(slice);
        });
      }
    }
    while (const auto results = job.take_results()) {
      received += results->size();
      bytes += bytes_of(*results);
    }
  }
  EXPECT_EQ(job.points_in_flight(), 0u);
  return bytes;
}

TEST(ProbeJob, SameBitsForAnyNumberOfThreadsAndAnyChunks) {
  const std::vector<Vec3f> points = some_points(500);
  const std::string reference = probe(points, 500, 1);
  EXPECT_EQ(probe(points, 500, 4), reference);
  EXPECT_EQ(probe(points, 64, 3), reference);
  EXPECT_EQ(probe(points, 7, 2), reference);
  EXPECT_EQ(probe(points, 1, 1), reference);
}

TEST(ProbeJob, AveragesTheRepeatsAndSaysWhichMediumHoldsThePoint) {
  const EstimatorSettings settings{.repeats = 5};
  ProbeJob job = make_job(settings);
  const Vec3f inside(0.1f, 0.2f, 0.3f);
  job.add({inside, {5, 0, 0}});
  make_estimator(job);
  EXPECT_TRUE(job.work(std::chrono::seconds(10)));
  EXPECT_FALSE(job.has_work());
  const auto results = job.take_results();
  ASSERT_TRUE(results);
  EXPECT_EQ(results->at(0).medium, 0);
  EXPECT_EQ(results->at(1).medium, scene::none);
  const auto expected = derivatives::average(FunctionEstimator(point_and_random), settings, inside);
  EXPECT_EQ(results->at(0).estimate.samples, expected.samples);
  EXPECT_EQ(results->at(0).estimate.mean.channels[1].value, expected.mean.channels[1].value);
  EXPECT_EQ(results->at(0).estimate.standard_error.channels[2].hessian(2, 0),
            expected.standard_error.channels[2].hessian(0, 2));
}

TEST(ProbeJob, ChunksComeOutInTheOrderInWhichTheyWentIn) {
  // The first point waits until all others are done.
  std::binary_semaphore entered(0);
  std::binary_semaphore release(0);
  ProbeJob job = make_job({.repeats = 1}, [&](const Vec3f& x, uint32_t, RayCounters&) {
    if (x.x == 0) {
      entered.release();
      release.acquire();
    }
    RadianceJet jet;
    jet.channels[0].value = x.x;
    return jet;
  });
  job.add({Vec3f(0)});
  job.add({Vec3f(1), Vec3f(2)});
  make_estimator(job);
  std::jthread slow([&] { job.work(slice); });
  entered.acquire();
  EXPECT_TRUE(job.work(std::chrono::seconds(10)));
  EXPECT_FALSE(job.take_results());
  release.release();
  slow.join();
  const auto first = job.take_results();
  ASSERT_TRUE(first);
  EXPECT_EQ(first->size(), 1u);
  EXPECT_EQ(first->at(0).estimate.mean.channels[0].value, 0);
  const auto second = job.take_results();
  ASSERT_TRUE(second);
  EXPECT_EQ(second->at(1).estimate.mean.channels[0].value, 2);
  EXPECT_FALSE(job.take_results());
}

TEST(ProbeJob, CancelledJobsBeginNoFurtherEstimate) {
  std::atomic<int> estimates = 0;
  ProbeJob* job_pointer = nullptr;
  ProbeJob job = make_job({.repeats = 100}, [&](const Vec3f&, uint32_t, RayCounters&) {
    if (++estimates == 3) job_pointer->cancel();
    return RadianceJet();
  });
  job_pointer = &job;
  job.add(some_points(10));
  make_estimator(job);
  EXPECT_FALSE(job.work(std::chrono::seconds(10)));
  EXPECT_EQ(estimates, 3);
  EXPECT_FALSE(job.has_work());
  EXPECT_FALSE(job.take_results());
  EXPECT_FALSE(job.failure());
}

TEST(ProbeJob, APointThatTakesLongIsLeftAndGoneOnWith) {
  const EstimatorSettings settings{.repeats = 50};
  const std::vector<Vec3f> points = some_points(3);
  ProbeJob job = make_job(settings);
  job.add(points);
  make_estimator(job);
  // A time slice of nothing is one estimate.
  int calls = 1;
  while (!job.work({})) ++calls;
  EXPECT_EQ(calls, 3 * 50);
  const auto results = job.take_results();
  ASSERT_TRUE(results);
  std::vector<PointResult> expected;
  for (const Vec3f& x : points)
    expected.push_back(
        {derivatives::average(FunctionEstimator(point_and_random), settings, x), fog_box()->medium_at(x)});
  EXPECT_EQ(bytes_of(*results), bytes_of(expected));
}

TEST(ProbeJob, ARunningEstimateSeesThatItIsNotWantedAnyMore) {
  ProbeJob* job_pointer = nullptr;
  ProbeJob job = make_job({.repeats = 2}, [&](const Vec3f&, uint32_t, RayCounters& counters) -> RadianceJet {
    job_pointer->cancel();
    while (true) counters.poll();
  });
  job_pointer = &job;
  job.add(some_points(2));
  make_estimator(job);
  EXPECT_FALSE(job.work(std::chrono::seconds(10)));
  EXPECT_FALSE(job.failure());
  EXPECT_FALSE(job.has_work());
}

std::string reason_of(const std::exception_ptr& failure) {
  try {
    if (failure) std::rethrow_exception(failure);
  } catch (const Error& error) {
    return error.reason();
  }
  return "";
}

TEST(ProbeJob, WhatTheEstimatorThrowsEndsTheJob) {
  ProbeJob failing(fog_box(), {}, []() -> std::unique_ptr<const Estimator> {
    throw Error(ErrorKind::unsupported, "NOT_KNOWN", "no such thing");
  });
  failing.add(some_points(2));
  EXPECT_TRUE(failing.work(slice));
  EXPECT_EQ(reason_of(failing.failure()), "NOT_KNOWN");
  EXPECT_FALSE(failing.has_work());

  ProbeJob not_finite = make_job({}, [](const Vec3f&, uint32_t, RayCounters&) {
    RadianceJet jet;
    jet.channels[2].hessian(1, 1) = std::numeric_limits<double>::quiet_NaN();
    return jet;
  });
  not_finite.add(some_points(1));
  make_estimator(not_finite);
  EXPECT_TRUE(not_finite.work(slice));
  EXPECT_EQ(reason_of(not_finite.failure()), "RESULT_NOT_FINITE");
}

TEST(ProbeJob, SettingsAreChecked) {
  for (const EstimatorSettings& settings : {EstimatorSettings{.samples = 15}, EstimatorSettings{.repeats = 0},
                                            EstimatorSettings{.max_depth = -2}}) {
    EXPECT_THROW(make_job(settings), Error);
  }
}

}  // namespace
}  // namespace fogbank::render
