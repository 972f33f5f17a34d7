#include "service/watch_stream.h"

#include <cmath>
#include <mutex>
#include <optional>

#include "service/answers.h"
#include "service/limits.h"
#include "service/names.h"

namespace fogbank::service {

namespace {

/// Lives as long as gRPC or the pump needs it. At most one write is outstanding; the stream is finished only
/// when none is.
class WatchStream final : public grpc::ServerWriteReactor<v1::WatchJobResponse>,
                          public PumpedStream,
                          public std::enable_shared_from_this<WatchStream> {
 public:
  WatchStream(grpc::CallbackServerContext& context, StreamPump& pump) : context_(context), pump_(pump) {}

  ~WatchStream() override {
    if (job_) job_->detach();
  }

  void start(std::shared_ptr<Job> job, const WatchCursor::Options& options) {
    job_ = std::move(job);
    begin_ = std::chrono::system_clock::now();
    job_->attach();
    cursor_.emplace(options, Clock::now());
    self_ = shared_from_this();
    pump_.add(self_);
  }

  void refuse(const grpc::Status& status) {
    self_ = shared_from_this();
    Finish(status);
  }

  Step step() override {
    {
      const std::lock_guard lock(mutex_);
      if (finished_) return {.state = State::finished, .retry_at = {}};
      if (writing_) return {.state = State::writing, .retry_at = {}};
      if (cancelled_ || last_written_) return finish(cancelled_ ? cancel_status() : grpc::Status::OK);
    }
    Job::NextEvent next;
    try {
      next = job_->next_event(*cursor_);
    } catch (...) {
      const std::lock_guard lock(mutex_);
      return finish(status_of(std::current_exception()));
    }
    {
      const std::lock_guard lock(mutex_);
      if (cancelled_) return finish(cancel_status());
      if (!next.message) return {.state = State::waiting, .retry_at = next.retry_at};
      message_ = std::move(*next.message);
      bytes_ += static_cast<int64_t>(message_.ByteSizeLong());
      if (message_.has_tile()) ++tiles_;
      last_written_ = next.last;
      writing_ = true;
      write_start_ = Clock::now();
    }
    StartWrite(&message_);
    return {.state = State::writing, .retry_at = {}};
  }

  void check_stall(Clock::time_point now) override {
    {
      const std::lock_guard lock(mutex_);
      if (finished_ || stalled_ || !writing_ || now - write_start_ < seconds(limits::watch_stall_seconds))
        return;
      stalled_ = true;
    }
    // Such a write never fails by itself. The context lives until the stream is finished, which only the
    // caller's thread does.
    context_.TryCancel();
  }

  void OnWriteDone(bool ok) override {
    {
      const std::lock_guard lock(mutex_);
      writing_ = false;
      if (!ok) cancelled_ = true;
    }
    pump_.ready(shared_from_this());
  }

  void OnCancel() override {
    {
      const std::lock_guard lock(mutex_);
      cancelled_ = true;
    }
    pump_.ready(shared_from_this());
  }

  void OnDone() override { self_.reset(); }

 private:
  /// With `mutex_` held and no write outstanding.
  Step finish(const grpc::Status& status) {
    finished_ = true;
    if (const auto trace = job_->trace_context()) {
      job_->traces()->write({.parent = *trace,
                             .id = new_span_id(),
                             .name = "send",
                             .begin = begin_,
                             .end = std::chrono::system_clock::now(),
                             .attributes = {{"fogbank.job", job_name(job_->id())},
                                            {"fogbank.tiles", tiles_},
                                            {"fogbank.bytes", bytes_}},
                             .failed = !status.ok()});
    }
    Finish(status);
    return {.state = State::finished, .retry_at = {}};
  }

  grpc::Status cancel_status() const {
    if (stalled_) {
      return to_grpc_status(
          {grpc::StatusCode::ABORTED, "WATCH_STALLED", "the client read nothing for too long"});
    }
    return grpc::Status::CANCELLED;
  }

  grpc::CallbackServerContext& context_;
  StreamPump& pump_;
  std::shared_ptr<Job> job_;
  std::optional<WatchCursor> cursor_;  ///< of the pump's thread
  v1::WatchJobResponse message_;       ///< of the outstanding write
  std::shared_ptr<WatchStream> self_;  ///< until OnDone
  Span::Time begin_;
  int64_t tiles_ = 0;  ///< written
  int64_t bytes_ = 0;

  std::mutex mutex_;
  bool writing_ = false;
  bool cancelled_ = false;
  bool stalled_ = false;
  bool last_written_ = false;
  bool finished_ = false;
  Clock::time_point write_start_;
};

WatchCursor::Options options_of(const v1::WatchJobRequest& request) {
  WatchCursor::Options options;
  options.since_revision = request.since_revision();
  options.tiles = !request.without_tiles();
  options.progress_interval = seconds(limits::progress_interval_seconds);
  options.heartbeat_interval = seconds(limits::heartbeat_seconds);
  if (request.has_update_interval_seconds()) {
    const double interval = request.update_interval_seconds();
    if (!(interval >= 0 && interval <= limits::max_update_interval_seconds)) {
      throw RpcError(
          grpc::StatusCode::INVALID_ARGUMENT, "INVALID_CADENCE",
          "update_interval_seconds must be 0 to " + std::to_string(limits::max_update_interval_seconds),
          {{"field", "update_interval_seconds"}});
    }
    options.interval = seconds(interval);
  }
  return options;
}

}  // namespace

grpc::ServerWriteReactor<v1::WatchJobResponse>* start_watch(grpc::CallbackServerContext& context,
                                                            const v1::WatchJobRequest& request,
                                                            const JobTable& jobs, const TenantQuota& quota,
                                                            StreamPump& pump) {
  const auto stream = std::make_shared<WatchStream>(context, pump);
  try {
    const WatchCursor::Options options = options_of(request);
    if (pump.streams() >= static_cast<size_t>(limits::max_watchers)) {
      throw RpcError(grpc::StatusCode::RESOURCE_EXHAUSTED, "TOO_MANY_WATCHERS",
                     "too many WatchJob streams are open", {{"limit", "max_watchers"}})
          .retry_after(limits::quota_retry_seconds);
    }
    quota.require_watcher(pump.streams());
    stream->start(jobs.find(parse_job_name(request.name())), options);
  } catch (...) {
    stream->refuse(status_of(std::current_exception()));
  }
  return stream.get();
}

}  // namespace fogbank::service
