// Radiance at points as a set of tasks: chunks of points go in, results come out in the order of the points.
// The caller owns the threads, as with render_job.h. A point's result depends on scene, settings and the
// point only, however points are cut into chunks and whichever thread takes them.
#pragma once

#include <atomic>
#include <chrono>
#include <cstddef>
#include <cstdint>
#include <deque>
#include <exception>
#include <functional>
#include <memory>
#include <mutex>
#include <optional>
#include <vector>

#include "core/vector.h"
#include "derivatives/estimate_average.h"
#include "transport/world.h"

namespace fogbank::render {

/// What is known of one point.
struct PointResult {
  derivatives::PointEstimate estimate;
  int32_t medium = scene::none;  ///< that holds the point, World::medium_at
};

/// Thread-safe.
class ProbeJob {
 public:
  using MakeEstimator = std::function<std::unique_ptr<const derivatives::Estimator>()>;

  /// `make_estimator` is called once, by the first task, as it may take its time. Throws as
  /// `derivatives::validate`.
  ProbeJob(std::shared_ptr<const transport::World> world, const derivatives::EstimatorSettings& settings,
           MakeEstimator make_estimator);

  /// Takes a chunk of finite points, at least one.
  void add(std::vector<Vec3f> points);

  /// Is there work that no thread has taken, as of now?
  bool has_work() const;
  /// Works on points that no other thread has taken, until there are none or the estimate is done during
  /// which `time_slice` ends; the first call makes the estimator instead. Returns true when a chunk became
  /// complete or the job failed. What the estimator throws is kept: see `failure`. Leaves the thread prepared
  /// for rendering.
  bool work(std::chrono::steady_clock::duration time_slice);

  /// Results of the oldest chunk that was not taken yet; nullopt while it is incomplete.
  std::optional<std::vector<PointResult>> take_results();
  /// Points that were added and whose results were not taken.
  size_t points_in_flight() const;

  /// No further estimate is begun; running ones stop as `derivatives::Estimator` says.
  void cancel();
  /// What the estimator threw, if it did; the job is cancelled then.
  std::exception_ptr failure() const;

 private:
  struct Chunk {
    std::vector<Vec3f> points;
    std::vector<derivatives::EstimateAverage> averages;  ///< of the same length, as is
    std::vector<PointResult> results;
    size_t begun = 0;
    size_t done = 0;
  };
  struct Claim {
    Chunk* chunk = nullptr;  ///< stays in `chunks_` until it is complete
    size_t index = 0;
  };

  /// With `mutex_` held.
  bool has_work_locked() const;
  std::optional<Claim> claim();
  /// The first call makes the estimator and returns true; then there is work for everybody.
  bool make_estimator();
  /// Works on a point until it is done or the time is over; false when the job is stopped.
  bool advance(const Claim& claimed, std::chrono::steady_clock::time_point end);
  /// Gives a point back; returns true when its chunk became complete.
  bool put_back(const Claim& claimed);
  void fail(std::exception_ptr failure);

  const std::shared_ptr<const transport::World> world_;
  const derivatives::EstimatorSettings settings_;
  const MakeEstimator make_estimator_;
  std::atomic<bool> stop_ = false;

  mutable std::mutex mutex_;
  std::unique_ptr<const derivatives::Estimator> estimator_;  ///< never changes once it is there
  bool making_estimator_ = false;                            ///< or it is there
  std::deque<Chunk> chunks_;  ///< oldest first; a deque's elements stay where they are
  size_t first_open_ = 0;     ///< the first chunk with points that were not begun, an index of `chunks_`
  std::deque<Claim> left_;    ///< points that were begun and given back, in this order
  size_t points_in_flight_ = 0;
  std::exception_ptr failure_;
};

}  // namespace fogbank::render
