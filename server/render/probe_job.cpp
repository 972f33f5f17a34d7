#include "render/probe_job.h"

#include <cmath>
#include <string>
#include <utility>

#include "core/error.h"
#include "scene/intersector.h"

namespace fogbank::render {

using derivatives::EstimateAverage;
using derivatives::EstimatorSettings;
using derivatives::Jet3d;
using derivatives::PointEstimate;

namespace {

bool is_finite(const Jet3d& jet) {
  bool finite = std::isfinite(jet.value);
  for (int i = 0; i < 3; ++i) finite = finite && std::isfinite(jet.gradient[i]);
  for (const double entry : jet.hessian.entries) finite = finite && std::isfinite(entry);
  return finite;
}

/// Estimators promise finite numbers; one that breaks its promise is told of here, before anybody computes
/// with it.
void check_finite(const PointEstimate& estimate, const Vec3f& x) {
  bool finite = is_finite(estimate.luminance_standard_error);
  for (size_t c = 0; c < 3; ++c) {
    finite = finite && is_finite(estimate.mean.channels[c]) && is_finite(estimate.standard_error.channels[c]);
  }
  if (finite) return;
  throw Error(ErrorKind::internal, "RESULT_NOT_FINITE",
              "the result at (" + std::to_string(x.x) + ", " + std::to_string(x.y) + ", " +
                  std::to_string(x.z) + ") is not finite");
}

}  // namespace

ProbeJob::ProbeJob(std::shared_ptr<const transport::World> world, const EstimatorSettings& settings,
                   MakeEstimator make_estimator)
    : world_(std::move(world)), settings_(settings), make_estimator_(std::move(make_estimator)) {
  derivatives::validate(settings_);
}

void ProbeJob::add(std::vector<Vec3f> points) {
  const std::lock_guard lock(mutex_);
  points_in_flight_ += points.size();
  Chunk& chunk = chunks_.emplace_back();
  chunk.points = std::move(points);
  chunk.averages.resize(chunk.points.size());
  chunk.results.resize(chunk.points.size());
}

bool ProbeJob::has_work() const {
  const std::lock_guard lock(mutex_);
  return has_work_locked();
}

bool ProbeJob::has_work_locked() const {
  const bool points = !left_.empty() || first_open_ < chunks_.size();
  return !stop_ && points && (estimator_ || !making_estimator_);
}

std::optional<ProbeJob::Claim> ProbeJob::claim() {
  const std::lock_guard lock(mutex_);
  if (!estimator_ || !has_work_locked()) return std::nullopt;
  if (!left_.empty()) {
    const Claim claimed = left_.front();
    left_.pop_front();
    return claimed;
  }
  Chunk& chunk = chunks_[first_open_];
  const Claim claimed{.chunk = &chunk, .index = chunk.begun++};
  if (chunk.begun == chunk.points.size()) ++first_open_;
  return claimed;
}

bool ProbeJob::advance(const Claim& claimed, std::chrono::steady_clock::time_point end) {
  const Vec3f& x = claimed.chunk->points[claimed.index];
  EstimateAverage& average = claimed.chunk->averages[claimed.index];
  do {
    if (!average.add(*estimator_, x, stop_)) return false;
  } while (average.count() < settings_.repeats && std::chrono::steady_clock::now() < end);
  if (average.count() == settings_.repeats) {
    const PointEstimate estimate = average.result();
    check_finite(estimate, x);
    claimed.chunk->results[claimed.index] = {.estimate = estimate, .medium = world_->medium_at(x)};
  }
  return true;
}

bool ProbeJob::put_back(const Claim& claimed) {
  const std::lock_guard lock(mutex_);
  if (claimed.chunk->averages[claimed.index].count() < settings_.repeats) {
    left_.push_back(claimed);
    return false;
  }
  return ++claimed.chunk->done == claimed.chunk->points.size();
}

bool ProbeJob::work(std::chrono::steady_clock::duration time_slice) {
  scene::prepare_render_thread();
  const auto end = std::chrono::steady_clock::now() + time_slice;
  bool completed = false;
  try {
    if (make_estimator()) return false;
    while (const std::optional<Claim> claimed = claim()) {
      if (!advance(*claimed, end)) break;
      completed = put_back(*claimed) || completed;
      if (std::chrono::steady_clock::now() >= end) break;
    }
  } catch (...) {
    fail(std::current_exception());
    return true;
  }
  return completed;
}

bool ProbeJob::make_estimator() {
  {
    const std::lock_guard lock(mutex_);
    if (making_estimator_ || stop_) return false;
    making_estimator_ = true;
  }
  std::unique_ptr<const derivatives::Estimator> made = make_estimator_();
  const std::lock_guard lock(mutex_);
  estimator_ = std::move(made);
  return true;
}

std::optional<std::vector<PointResult>> ProbeJob::take_results() {
  const std::lock_guard lock(mutex_);
  if (chunks_.empty() || chunks_.front().done < chunks_.front().points.size()) return std::nullopt;
  std::vector<PointResult> results = std::move(chunks_.front().results);
  chunks_.pop_front();
  --first_open_;
  points_in_flight_ -= results.size();
  return results;
}

size_t ProbeJob::points_in_flight() const {
  const std::lock_guard lock(mutex_);
  return points_in_flight_;
}

void ProbeJob::cancel() { stop_ = true; }

void ProbeJob::fail(std::exception_ptr failure) {
  const std::lock_guard lock(mutex_);
  if (!failure_) failure_ = std::move(failure);
  stop_ = true;
}

std::exception_ptr ProbeJob::failure() const {
  const std::lock_guard lock(mutex_);
  return failure_;
}

}  // namespace fogbank::render
