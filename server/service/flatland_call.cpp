#include "service/flatland_call.h"

#include <limits>
#include <memory>
#include <mutex>
#include <optional>
#include <vector>

#include "service/answers.h"
#include "service/flatland_messages.h"
#include "service/limits.h"

namespace fogbank::service {

namespace flatland = derivatives::flatland;

namespace {

/// What a call computes. All but tasks is called by one thread at a time.
class FlatlandWork {
 public:
  virtual ~FlatlandWork() = default;
  /// Checks the request; the first to be called. May throw, as tasks may.
  virtual void begin() = 0;
  /// The next task, or an empty function after the last one.
  virtual std::function<void()> take() = 0;
  /// Whether the last task has been taken.
  virtual bool exhausted() const = 0;
  /// Most tasks to run at once.
  virtual int max_threads() const { return std::numeric_limits<int>::max(); }
  /// After all tasks have ended.
  virtual void answer() = 0;
};

/// Estimates at independent points.
class ProbeWork final : public FlatlandWork {
 public:
  ProbeWork(const v1::ProbeFlatlandRequest& request, v1::ProbeFlatlandResponse& response)
      : request_(request), response_(response) {}

  void begin() override {
    model_.emplace(to_model(request_.scene(), request_.settings()));
    points_ = to_points(request_.coordinates(), model_->scene(), limits::max_flatland_points,
                        "max_flatland_points");
    estimates_.resize(points_.size());
    if (model_->settings().order == derivatives::Order::single) points_per_task_ = cheap_points_per_task;
  }

  std::function<void()> take() override {
    if (exhausted()) return {};
    const size_t first = next_;
    next_ = std::min(points_.size(), first + points_per_task_);
    return [this, first, last = next_] {
      for (size_t i = first; i < last; ++i) estimates_[i] = model_->estimate(points_[i]);
    };
  }

  bool exhausted() const override { return next_ >= points_.size(); }

  void answer() override {
    set_effective(*response_.mutable_settings(), model_->settings());
    set_response(response_, estimates_);
  }

 private:
  /// Points of single scattering take microseconds, so several make a task; the others milliseconds.
  static constexpr size_t cheap_points_per_task = 64;

  const v1::ProbeFlatlandRequest& request_;
  v1::ProbeFlatlandResponse& response_;
  std::optional<flatland::Model> model_;
  std::vector<Vec2d> points_;
  size_t points_per_task_ = 1;
  size_t next_ = 0;
  std::vector<flatland::Estimate> estimates_;  ///< each written by one task
};

/// The fill of a cache, in which every step depends on the one before.
class FillWork final : public FlatlandWork {
 public:
  FillWork(const v1::FillFlatlandCacheRequest& request, v1::FillFlatlandCacheResponse& response)
      : request_(request), response_(response) {}

  void begin() override {
    model_ = std::make_shared<flatland::Model>(to_model(request_.scene(), request_.settings()));
    fill_.emplace(to_fill(request_.cache(), model_,
                          to_points(request_.coordinates(), model_->scene(),
                                    limits::max_flatland_cache_points, "max_flatland_cache_points")));
  }

  std::function<void()> take() override {
    if (exhausted()) return {};
    return [this] { more_ = fill_->fill.advance(points_per_task); };
  }

  bool exhausted() const override { return !more_; }
  int max_threads() const override { return 1; }

  void answer() override {
    set_effective(*response_.mutable_settings(), model_->settings());
    set_response(response_, *fill_);
  }

 private:
  /// A few milliseconds where each gets a record.
  static constexpr size_t points_per_task = 64;

  const v1::FillFlatlandCacheRequest& request_;
  v1::FillFlatlandCacheResponse& response_;
  std::shared_ptr<const flatland::Model> model_;
  std::optional<FlatlandFill> fill_;
  bool more_ = true;
};

/// Lives until gRPC and the scheduler have let go of it. Finishes once: when the last task has ended, after
/// an error or a cancellation as soon as none runs.
class FlatlandCall final : public grpc::ServerUnaryReactor,
                           public Workload,
                           public std::enable_shared_from_this<FlatlandCall> {
 public:
  FlatlandCall(std::unique_ptr<FlatlandWork> work, Scheduler& scheduler, int group)
      : work_(std::move(work)), scheduler_(scheduler), group_(group) {}

  void start(TaskQueue& control) {
    self_ = shared_from_this();
    if (control.post([call = self_] { call->begin(); })) return;
    fail(shutting_down_status());
    end_task();
  }

  std::function<void()> take() override {
    const std::lock_guard lock(mutex_);
    if (status_ || running_ >= work_->max_threads()) return {};
    std::function<void()> task = work_->take();
    if (!task) return {};
    ++running_;
    return [call = shared_from_this(), task = std::move(task)] { call->run(task); };
  }

  int group() const override { return group_; }

  void OnCancel() override { fail(grpc::Status::CANCELLED); }
  void OnDone() override { self_.reset(); }

 private:
  /// The first task.
  void begin() {
    try {
      work_->begin();
      scheduler_.add(shared_from_this());
    } catch (...) {
      fail(status_of(std::current_exception()));
    }
    end_task();
    scheduler_.wake();
  }

  void run(const std::function<void()>& task) {
    try {
      task();
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
      if (finished_ || running_ > 0 || (!status_ && !work_->exhausted())) return;
      finished_ = true;
      status = status_.value_or(grpc::Status::OK);
    }
    scheduler_.remove(*this);
    if (status.ok()) work_->answer();
    Finish(status);
  }

  std::unique_ptr<FlatlandWork> work_;
  Scheduler& scheduler_;
  const int group_;
  std::shared_ptr<FlatlandCall> self_;  ///< gRPC's hold

  std::mutex mutex_;  ///< never held while the scheduler is called, which calls `take`
  int running_ = 1;   ///< tasks, `begin` included
  bool finished_ = false;
  std::optional<grpc::Status> status_;  ///< of a failure
};

template <typename Work, typename Request, typename Response>
grpc::ServerUnaryReactor* start(const Request& request, Response& response, TaskQueue& control,
                                Scheduler& scheduler, int group) {
  const auto call =
      std::make_shared<FlatlandCall>(std::make_unique<Work>(request, response), scheduler, group);
  call->start(control);
  return call.get();
}

}  // namespace

grpc::ServerUnaryReactor* start_flatland_call(const v1::ProbeFlatlandRequest& request,
                                              v1::ProbeFlatlandResponse& response, TaskQueue& control,
                                              Scheduler& scheduler, int group) {
  return start<ProbeWork>(request, response, control, scheduler, group);
}

grpc::ServerUnaryReactor* start_flatland_call(const v1::FillFlatlandCacheRequest& request,
                                              v1::FillFlatlandCacheResponse& response, TaskQueue& control,
                                              Scheduler& scheduler, int group) {
  return start<FillWork>(request, response, control, scheduler, group);
}

}  // namespace fogbank::service
