#include "render/own_share.h"

#include <algorithm>

namespace fogbank::render {

namespace {

/// Weight of the newest task.
constexpr double learning = 0.3;

}  // namespace

void OwnShare::set_trip_seconds(double seconds, Clock::time_point now) {
  const bool first = !trip_seconds_;
  trip_seconds_ = seconds;
  if (first && work_left_ > 0) keep(now);
}

void OwnShare::begin_stage(uint32_t kind, double work, Clock::time_point now) {
  kind_ = kind;
  work_left_ = work;
  keep(now);
}

void OwnShare::begin_leased_stage() {
  work_left_ = 0;
  kept_until_ = {};
}

void OwnShare::learn(double work, double cpu_seconds, Clock::time_point now) {
  if (!(work_left_ > 0) || !(work > 0) || !(cpu_seconds >= 0)) return;
  const double measured = cpu_seconds / work;
  const auto [known, first] = unit_seconds_.try_emplace(kind_, measured);
  if (!first) known->second += learning * (measured - known->second);
  work_left_ = std::max(0.0, work_left_ - work);
  judge(now);
}

void OwnShare::keep(Clock::time_point now) {
  // The prediction may be wrong, and the threads may have other jobs' tasks to run.
  const std::chrono::duration<double> most(trip_seconds_.value_or(0));
  kept_until_ = now + std::chrono::duration_cast<Clock::duration>(most);
  judge(now);
}

void OwnShare::judge(Clock::time_point now) {
  const auto known = unit_seconds_.find(kind_);
  if (known == unit_seconds_.end()) return;
  if (known->second * work_left_ > trip_seconds_.value_or(0)) kept_until_ = std::min(kept_until_, now);
}

}  // namespace fogbank::render
