// The part of Job that lets others perform its tasks.
#include "core/error.h"
#include "render/render_job.h"
#include "service/job.h"
#include "service/leased_messages.h"
#include "service/limits.h"

namespace fogbank::service {

using grpc::StatusCode;

namespace {

/// A tile of the greatest size with both layers, and what stands around it.
constexpr int64_t greatest_input_bytes =
    int64_t{render::RenderLimits::largest_tile} * render::RenderLimits::largest_tile * 96 + 256;
static_assert(2 * greatest_input_bytes <= limits::max_lease_bytes);

RpcError log_changed() {
  return {StatusCode::FAILED_PRECONDITION, "LOG_CHANGED",
          "the job has begun again since that log: its replicas and results are of no use"};
}

}  // namespace

void Job::expect_leased() const {
  if (leased()) return;
  throw RpcError(StatusCode::FAILED_PRECONDITION, "JOB_NOT_LEASED",
                 "the server itself performs this job's tasks; create it as leased");
}

std::string Job::log_id() const { return id_ + "-" + std::to_string(base_.restarts()); }

Job::Leased Job::lease(const v1::LeaseTasksRequest& request, v1::LeaseTasksResponse& response) {
  expect_leased();
  int most_tasks = request.max_tasks();
  std::shared_ptr<render::RenderJob> job;
  {
    const std::lock_guard lock(mutex_);
    response.set_state(base_.state());
    if (suspended_ && !has_ended(base_.state())) throw shutting_down();
    response.set_own_tasks(own_tasks_);
    response.set_own_cpu_seconds(own_cpu_seconds_);
    if (!render_job_ || stop_ || finishing_) return {};
    job = render_job_;
    response.set_log(log_id());
    if (coordinator_ != request.coordinator()) {
      coordinator_ = request.coordinator();
      job->recall_leases();
    }
    if (paused_) most_tasks = 0;
  }
  job->set_trip_seconds(request.trip_seconds());
  int64_t bytes = 0;
  while (response.tasks_size() < most_tasks && bytes + greatest_input_bytes <= limits::max_lease_bytes) {
    std::optional<render::LeasedTask> task = job->lease();
    if (!task) break;
    set_task(*response.add_tasks(), std::move(*task));
    bytes += static_cast<int64_t>(response.tasks(response.tasks_size() - 1).ByteSizeLong());
  }
  const render::RenderJob::Stage stage = job->stage();
  response.set_stage(stage.number);
  response.set_stage_tasks(stage.tasks);
  response.set_log_length(stage.log_length);
  // The job may have gone on to another stage in between, by its time or its cancellation.
  for (int i = response.tasks_size(); i-- > 0;)
    if (response.tasks(i).stage() != stage.number) response.mutable_tasks()->DeleteSubrange(i, 1);
  // Its threads have something to do, or a stage that they had to themselves is leased by now.
  const bool due = job->caller_due();
  if (due || response.tasks_size() > 0) services_.settle(shared_from_this());
  Leased leased{.own = due, .own_until = job->callers_until()};
  const std::lock_guard lock(mutex_);
  if (response.tasks_size() > 0) leased_stage_ = stage.number;
  leased.outdated =
      leased_stage_ > 0 && request.known_stage() == leased_stage_ && stage.number != leased_stage_;
  return leased;
}

void Job::complete(const std::string& log, const v1::TaskResultPart& last_part, std::string bytes,
                   v1::CompleteTasksResponse& response) {
  expect_leased();
  const render::TaskResult result = to_result(last_part, std::move(bytes));
  std::shared_ptr<render::RenderJob> job;
  {
    const std::lock_guard lock(mutex_);
    if (log != log_id()) throw log_changed();
    if (render_job_ && !stop_ && !suspended_ && !finishing_) {
      job = render_job_;
      ++completing_;
    }
  }
  render::Completion completion = render::Completion::ignored;
  bool refused = false;
  if (job) {
    try {
      completion = job->complete(last_part.stage(), last_part.index(), result);
    } catch (const Error& error) {
      refused = true;
      v1::RefusedResult& message = *response.add_refused();
      message.set_stage(last_part.stage());
      message.set_index(last_part.index());
      message.set_reason(error.reason());
      message.set_message(error.what());
    }
    const std::lock_guard lock(mutex_);
    --completing_;
    if (completion != render::Completion::ignored && !stop_) {
      render_cpu_seconds_ += result.cpu_seconds;
      const bool last_tile = completion == render::Completion::last_tile;
      const bool tile = last_tile || completion == render::Completion::tile;
      account(tile ? std::optional(last_part.index()) : std::nullopt, last_tile);
    }
    finish_if_idle();
  }
  if (completion != render::Completion::ignored) {
    response.set_accepted(response.accepted() + 1);
  } else if (!refused) {
    response.set_ignored(response.ignored() + 1);
  }
  if (!job) return;
  services_.settle(shared_from_this());
  services_.changed();
}

void Job::read_log(const std::string& log, uint64_t first, v1::ReadJobLogResponse& response) const {
  expect_leased();
  std::shared_ptr<render::RenderJob> job;
  {
    const std::lock_guard lock(mutex_);
    if (!render_job_) {
      throw RpcError(StatusCode::FAILED_PRECONDITION, "JOB_NOT_RUNNING",
                     "the job has not begun, or it has ended");
    }
    if (log != log_id()) throw log_changed();
    job = render_job_;
  }
  const uint64_t length = job->log().length();
  response.set_length(length);
  if (first > length) {
    throw RpcError(StatusCode::INVALID_ARGUMENT, "INVALID_OFFSET",
                   "first: the log has " + std::to_string(length) + " entries", {{"field", "first"}});
  }
  int64_t bytes = 0;
  for (uint64_t index = first; index < length; ++index) {
    const auto entry = job->log().entry(index);
    bytes += static_cast<int64_t>(entry->data.size()) + 128;
    if (bytes > limits::max_lease_bytes) break;
    v1::JobLogEntry& message = *response.add_entries();
    message.set_index(index);
    message.set_sha256(entry->sha256);
    message.set_data(entry->data);
  }
}

}  // namespace fogbank::service
