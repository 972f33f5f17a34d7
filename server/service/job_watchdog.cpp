// The part of Job that looks after tasks that run too long.
#include <spdlog/spdlog.h>

#include <algorithm>
#include <string>

#include "service/job.h"

namespace fogbank::service {

namespace {

std::string task_name(const render::Task& task) {
  const auto* const tile = std::get_if<render::TileTask>(&task);
  if (tile == nullptr) return "a task between passes";
  return "tile " + std::to_string(tile->tile) + " of pass " + std::to_string(tile->pass);
}

}  // namespace

bool Job::has_running_tasks() const {
  return completing_ > 0 ||
         std::ranges::any_of(running_, [](const auto& item) { return !item.second.given_up; });
}

void Job::watch_tasks(Clock::time_point now) {
  const TaskLimits& bounds = services_.task_limits;
  std::optional<RpcError> stuck;
  {
    const std::lock_guard lock(mutex_);
    for (auto& [number, running] : running_) {
      const double seconds = to_seconds(now - running.start);
      if (seconds >= bounds.report_seconds && !running.reported) {
        running.reported = true;
        services_.slow_tasks += 1;
        spdlog::warn("{}: {} runs for {:.1f} s", base_.name(), task_name(running.task), seconds);
      }
      if (seconds >= bounds.limit_seconds) {
        stuck = RpcError(grpc::StatusCode::DEADLINE_EXCEEDED, "TASK_STUCK",
                         task_name(running.task) + " did not end within " +
                             std::to_string(static_cast<int64_t>(bounds.limit_seconds)) + " s",
                         {{"seconds", std::to_string(static_cast<int64_t>(seconds))}});
      }
      if (seconds >= bounds.limit_seconds + limits::stuck_task_seconds && stop_ && !running.given_up) {
        running.given_up = true;
        services_.lost_threads += 1;
        spdlog::error("{}: {} goes on after {:.1f} s; the job ends without it, and a render thread is lost",
                      base_.name(), task_name(running.task), seconds);
      }
    }
  }
  if (!stuck) return;
  fail(*stuck);
  const std::lock_guard lock(mutex_);
  if (!has_ended(base_.state())) finish_if_idle();
}

std::optional<TraceContext> Job::trace_context() const {
  const std::lock_guard lock(mutex_);
  return trace_.context();
}

}  // namespace fogbank::service
