#include "service/lease_call.h"

#include <algorithm>
#include <atomic>
#include <memory>
#include <optional>
#include <utility>

#include "service/answers.h"
#include "service/limits.h"
#include "service/names.h"

namespace fogbank::service {

using grpc::StatusCode;

namespace {

/// So often a waiting call looks whether the job's time is over, which nobody else may notice.
constexpr double look_seconds = 0.25;

RpcError invalid_lease(const std::string& field, const std::string& why) {
  return {StatusCode::INVALID_ARGUMENT, "INVALID_LEASE", field + ": " + why, {{"field", field}}};
}

/// Lives as long as gRPC or the pump needs it.
class LeaseCall final : public grpc::ServerUnaryReactor,
                        public PumpedStream,
                        public std::enable_shared_from_this<LeaseCall> {
 public:
  LeaseCall(grpc::CallbackServerContext& context, const v1::LeaseTasksRequest& request,
            v1::LeaseTasksResponse& response, Tenants& tenants)
      : context_(context), request_(request), response_(response), tenants_(tenants) {}

  void start(TaskQueue& control) {
    self_ = shared_from_this();
    const bool posted = control.post([self = shared_from_this()] {
      try {
        self->begin();
      } catch (...) {
        self->Finish(status_of(std::current_exception()));
      }
    });
    if (!posted) Finish(shutting_down_status());
  }

  Step step() override {
    if (finished_) return {.state = State::finished, .retry_at = {}};
    if (cancelled_) return finish(grpc::Status::CANCELLED);
    Job::Leased leased;
    try {
      response_.Clear();
      leased = job_->lease(request_, response_);
    } catch (...) {
      return finish(status_of(std::current_exception()));
    }
    const Clock::time_point now = Clock::now();
    const bool known = response_.stage() == request_.known_stage() || response_.stage_tasks() == 0;
    if (response_.tasks_size() > 0 || has_ended(response_.state()) || now >= end_ ||
        (!known && (!leased.own || leased.outdated)))
      return finish(grpc::Status::OK);
    Clock::time_point look = std::min(end_, now + seconds(look_seconds));
    if (leased.own_until > now) look = std::min(look, leased.own_until);
    return {.state = State::waiting, .retry_at = look};
  }

  void check_stall(Clock::time_point) override {}

  void OnCancel() override {
    cancelled_ = true;
    if (pump_ != nullptr) pump_.load()->ready(shared_from_this());
  }

  void OnDone() override { self_.reset(); }

 private:
  void begin() {
    Tenant& tenant = tenants_.enter(context_, "FarmService.LeaseTasks");
    if (request_.max_tasks() < 1 || request_.max_tasks() > limits::max_leased_tasks)
      throw invalid_lease("max_tasks", "must be 1 to " + std::to_string(limits::max_leased_tasks));
    if (!(request_.trip_seconds() >= 0 && request_.trip_seconds() <= limits::max_trip_seconds))
      throw invalid_lease("trip_seconds", "must be 0 to max_trip_seconds");
    if (!(request_.wait_seconds() >= 0 && request_.wait_seconds() <= limits::max_lease_wait_seconds))
      throw invalid_lease("wait_seconds", "must be 0 to max_lease_wait_seconds");
    try {
      check_request_id(request_.coordinator());
    } catch (const RpcError&) {
      throw invalid_lease("coordinator", "must be 1 to 64 characters of [A-Za-z0-9_-]");
    }
    if (tenant.pump.streams() >= static_cast<size_t>(limits::max_watchers)) {
      throw RpcError(StatusCode::RESOURCE_EXHAUSTED, "TOO_MANY_WATCHERS", "too many calls wait for jobs",
                     {{"limit", "max_watchers"}});
    }
    job_ = tenant.jobs.find(parse_job_name(request_.job()));
    end_ = Clock::now() + seconds(request_.wait_seconds());
    tenant.pump.add(shared_from_this());
    pump_ = &tenant.pump;
  }

  /// By the pump's thread, once.
  Step finish(const grpc::Status& status) {
    finished_ = true;
    Finish(status);
    return {.state = State::finished, .retry_at = {}};
  }

  grpc::CallbackServerContext& context_;
  const v1::LeaseTasksRequest request_;
  v1::LeaseTasksResponse& response_;
  Tenants& tenants_;
  std::shared_ptr<LeaseCall> self_;  ///< until OnDone
  std::shared_ptr<Job> job_;
  Clock::time_point end_;
  std::atomic<StreamPump*> pump_ = nullptr;
  std::atomic<bool> cancelled_ = false;
  bool finished_ = false;  ///< of the pump's thread
};

}  // namespace

grpc::ServerUnaryReactor* start_lease(grpc::CallbackServerContext& context,
                                      const v1::LeaseTasksRequest& request, v1::LeaseTasksResponse& response,
                                      Tenants& tenants, TaskQueue& control) {
  const auto call = std::make_shared<LeaseCall>(context, request, response, tenants);
  call->start(control);
  return call.get();
}

}  // namespace fogbank::service
