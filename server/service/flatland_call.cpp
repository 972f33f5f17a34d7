#include "service/flatland_call.h"

#include <memory>
#include <mutex>
#include <optional>
#include <vector>

#include "service/answers.h"
#include "service/flatland_messages.h"

namespace fogbank::service {

namespace flatland = derivatives::flatland;

namespace {

/// Points of single scattering take microseconds, so several make a task; the others milliseconds.
constexpr size_t cheap_points_per_task = 64;

/// Lives until gRPC and the scheduler have let go of it. Finishes once: when the last task has ended, after
/// an error or a cancellation as soon as none runs.
class FlatlandCall final : public grpc::ServerUnaryReactor,
                           public Workload,
                           public std::enable_shared_from_this<FlatlandCall> {
 public:
  FlatlandCall(const v1::ProbeFlatlandRequest& request, v1::ProbeFlatlandResponse& response,
               Scheduler& scheduler)
      : request_(request), response_(response), scheduler_(scheduler) {}

  void start(TaskQueue& control) {
    self_ = shared_from_this();
    if (control.post([call = self_] { call->begin(); })) return;
    fail(shutting_down_status());
    end_task();
  }

  std::function<void()> take() override {
    const std::lock_guard lock(mutex_);
    if (status_ || next_ >= points_.size()) return {};
    const size_t first = next_;
    next_ = std::min(points_.size(), first + points_per_task_);
    ++running_;
    return [call = shared_from_this(), first, last = next_] { call->run(first, last); };
  }

  void OnCancel() override { fail(grpc::Status::CANCELLED); }
  void OnDone() override { self_.reset(); }

 private:
  /// The first task.
  void begin() {
    try {
      model_.emplace(to_model(request_));
      points_ = to_points(request_, model_->scene());
      estimates_.resize(points_.size());
      if (model_->settings().order == derivatives::Order::single) points_per_task_ = cheap_points_per_task;
      scheduler_.add(shared_from_this());
    } catch (...) {
      fail(status_of(std::current_exception()));
    }
    end_task();
  }

  void run(size_t first, size_t last) {
    try {
      for (size_t i = first; i < last; ++i) estimates_[i] = model_->estimate(points_[i]);
    } catch (...) {
      fail(status_of(std::current_exception()));
    }
    end_task();
  }

  void end_task() {
    {
      const std::lock_guard lock(mutex_);
      --running_;
    }
    finish_if_over();
  }

  void fail(const grpc::Status& status) {
    {
      const std::lock_guard lock(mutex_);
      if (!status_) status_ = status;
    }
    finish_if_over();
  }

  void finish_if_over() {
    grpc::Status status;
    {
      const std::lock_guard lock(mutex_);
      if (finished_ || running_ > 0 || (!status_ && next_ < points_.size())) return;
      finished_ = true;
      status = status_.value_or(grpc::Status::OK);
    }
    scheduler_.remove(*this);
    if (status.ok()) set_response(response_, model_->settings(), estimates_);
    Finish(status);
  }

  const v1::ProbeFlatlandRequest& request_;
  v1::ProbeFlatlandResponse& response_;
  Scheduler& scheduler_;
  std::shared_ptr<FlatlandCall> self_;  ///< gRPC's hold

  // Written by `begin`, before any other task.
  std::optional<flatland::Model> model_;
  std::vector<Vec2d> points_;
  size_t points_per_task_ = 1;
  std::vector<flatland::Estimate> estimates_;  ///< each written by one task

  std::mutex mutex_;  ///< never held while the scheduler is called, which calls `take`
  size_t next_ = 0;
  int running_ = 1;  ///< tasks, `begin` included
  bool finished_ = false;
  std::optional<grpc::Status> status_;  ///< of a failure
};

}  // namespace

grpc::ServerUnaryReactor* start_flatland_call(const v1::ProbeFlatlandRequest& request,
                                              v1::ProbeFlatlandResponse& response, TaskQueue& control,
                                              Scheduler& scheduler) {
  const auto call = std::make_shared<FlatlandCall>(request, response, scheduler);
  call->start(control);
  return call.get();
}

}  // namespace fogbank::service
