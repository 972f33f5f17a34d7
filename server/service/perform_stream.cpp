#include "service/perform_stream.h"

#include <deque>
#include <mutex>
#include <optional>
#include <utility>
#include <vector>

#include "core/ray_counters.h"
#include "service/answers.h"
#include "service/leased_messages.h"
#include "service/limits.h"
#include "service/names.h"

namespace fogbank::service {

using grpc::StatusCode;

namespace {

/// Results that wait for the client to read them: beyond, no task is begun.
constexpr size_t most_waiting_bytes = size_t{16} << 20;

/// Lives as long as gRPC, the pump or the scheduler needs it. At most one write is outstanding; the stream is
/// finished only when none is.
class PerformStream final : public grpc::ServerWriteReactor<v1::PerformTasksResponse>,
                            public PumpedStream,
                            public Workload,
                            public std::enable_shared_from_this<PerformStream> {
 public:
  PerformStream(grpc::CallbackServerContext& context, const v1::PerformTasksRequest& request,
                std::shared_ptr<OpenedReplica> replica, PerformServices& services)
      : context_(context), services_(services), replica_(std::move(replica)) {
    for (const v1::LeasedTask& task : request.tasks()) tasks_.push_back(to_task(task));
  }

  void start() {
    self_ = shared_from_this();
    services_.pump.add(self_);
    update_scheduler();
  }

  // Workload

  std::function<void()> take() override {
    const std::lock_guard lock(mutex_);
    if (!has_task()) return {};
    const size_t number = next_task_++;
    ++running_;
    return [self = shared_from_this(), number] { self->perform(number); };
  }
  int group() const override { return services_.group; }

  // PumpedStream

  Step step() override {
    const Step result = next_step();
    // Whatever render threads did meanwhile, a finished stream does not stay in the scheduler's list.
    if (result.state == State::finished) update_scheduler();
    return result;
  }

  void check_stall(Clock::time_point now) override {
    {
      const std::lock_guard lock(mutex_);
      if (finished_ || stalled_ || !writing_ || now - write_start_ < seconds(limits::watch_stall_seconds))
        return;
      stalled_ = true;
    }
    context_.TryCancel();
  }

  void OnWriteDone(bool ok) override {
    leave_news([this, ok] {
      writing_ = false;
      if (!ok) cancelled_ = true;
    });
  }

  void OnCancel() override {
    stop_ = true;  // at once, however busy the pump is
    leave_news([this] { cancelled_ = true; });
  }

  void OnDone() override { self_.reset(); }

 private:
  Step next_step() {
    {
      const std::lock_guard lock(mutex_);
      if (finished_) return {.state = State::finished, .retry_at = {}};
      if (!failure_ && cancelled_) failure_ = cancel_status();
      if (!failure_ && services_.shutting_down) failure_ = shutting_down_status();
      if (!failure_ && replica_->closed) {
        failure_ = to_grpc_status({StatusCode::NOT_FOUND,
                                   "REPLICA_NOT_FOUND",
                                   "the replica was closed",
                                   {{"name", replica_name(replica_->id)}}});
      }
      if (failure_) stop_ = true;
    }
    update_scheduler();
    const std::lock_guard lock(mutex_);
    if (writing_) return {.state = State::writing, .retry_at = {}};
    if (failure_) return finish(*failure_);
    if (results_.empty()) {
      if (next_task_ == tasks_.size() && running_ == 0)
        return finish(cancelled_ ? cancel_status() : grpc::Status::OK);
      return {.state = State::waiting, .retry_at = Clock::time_point::max()};
    }
    const auto& [number, result] = results_.front();
    set_part(*response_.mutable_part(), tasks_[number], result, offset_);
    offset_ += response_.part().data().size();
    if (response_.part().last()) {
      waiting_bytes_ -= result.bytes.size();
      offset_ = 0;
      results_.pop_front();
    }
    writing_ = true;
    write_start_ = Clock::now();
    StartWrite(&response_);
    return {.state = State::writing, .retry_at = {}};
  }

  template <typename Change>
  void leave_news(Change change) {
    {
      const std::lock_guard lock(mutex_);
      change();
    }
    services_.pump.ready(shared_from_this());
  }

  /// With `mutex_` held.
  bool has_task() const {
    return !stop_ && !finished_ && !failure_ && !cancelled_ && next_task_ < tasks_.size() &&
           waiting_bytes_ <= most_waiting_bytes;
  }

  void perform(size_t number) {
    std::optional<render::TaskResult> result;
    std::optional<grpc::Status> failure;
    try {
      result = replica_->replica.perform(tasks_[number], stop_);
    } catch (const Interrupted&) {
      // Nobody waits for it.
    } catch (...) {
      failure = to_grpc_status(
          with_log_length(to_rpc_error(std::current_exception()), replica_->replica.log_length()));
    }
    leave_news([&] {
      --running_;
      if (failure && !failure_) failure_ = std::move(failure);
      if (!result) return;
      waiting_bytes_ += result->bytes.size();
      results_.emplace_back(number, std::move(*result));
    });
  }

  /// A workload without tasks must not stay in the scheduler's list.
  void update_scheduler() {
    const std::lock_guard one_at_a_time(scheduling_);
    bool wanted = false;
    {
      const std::lock_guard lock(mutex_);
      wanted = has_task();
    }
    if (wanted && !scheduled_) {
      services_.scheduler.add(shared_from_this());
    } else if (wanted) {
      services_.scheduler.wake();  // it may have found no room for a result since the last look
    } else if (scheduled_) {
      services_.scheduler.remove(*this);
    }
    scheduled_ = wanted;
  }

  /// With `mutex_` held and no write outstanding.
  Step finish(const grpc::Status& status) {
    finished_ = true;
    stop_ = true;  // nobody waits for what still runs
    Finish(status);
    return {.state = State::finished, .retry_at = {}};
  }

  grpc::Status cancel_status() const {
    if (!stalled_) return grpc::Status::CANCELLED;
    return to_grpc_status({StatusCode::ABORTED, "PERFORM_STALLED", "the client read nothing for too long"});
  }

  grpc::CallbackServerContext& context_;
  PerformServices& services_;
  const std::shared_ptr<OpenedReplica> replica_;
  std::vector<render::LeasedTask> tasks_;
  std::shared_ptr<PerformStream> self_;  ///< until OnDone
  v1::PerformTasksResponse response_;    ///< of the outstanding write
  std::atomic<bool> stop_ = false;       ///< for the tasks that run

  std::mutex scheduling_;  ///< before `mutex_`
  bool scheduled_ = false;

  std::mutex mutex_;
  size_t next_task_ = 0;
  size_t running_ = 0;
  std::deque<std::pair<size_t, render::TaskResult>> results_;  ///< by number of the task
  size_t offset_ = 0;                                          ///< in the first of them
  size_t waiting_bytes_ = 0;
  std::optional<grpc::Status> failure_;
  bool writing_ = false;
  bool cancelled_ = false;
  bool stalled_ = false;
  bool finished_ = false;
  Clock::time_point write_start_;
};

}  // namespace

grpc::ServerWriteReactor<v1::PerformTasksResponse>* start_performing(grpc::CallbackServerContext& context,
                                                                     const v1::PerformTasksRequest& request,
                                                                     ReplicaTable& replicas,
                                                                     PerformServices& services) {
  if (services.shutting_down) throw shutting_down();
  if (request.tasks().empty() || request.tasks_size() > limits::max_leased_tasks) {
    throw RpcError(StatusCode::INVALID_ARGUMENT, "INVALID_TASK",
                   "tasks: there must be 1 to " + std::to_string(limits::max_leased_tasks),
                   {{"field", "tasks"}});
  }
  std::shared_ptr<OpenedReplica> replica = replicas.find(parse_replica_name(request.replica()));
  const uint64_t length = replica->replica.log_length();
  if (length < request.log_length()) {
    throw RpcError(StatusCode::FAILED_PRECONDITION, "REPLICA_BEHIND",
                   "the replica has replayed " + std::to_string(length) + " entries of the log only",
                   {{"log_length", std::to_string(length)}});
  }
  const auto stream = std::make_shared<PerformStream>(context, request, std::move(replica), services);
  stream->start();
  return stream.get();
}

}  // namespace fogbank::service
