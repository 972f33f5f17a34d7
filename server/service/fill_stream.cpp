#include "service/fill_stream.h"

#include <exception>
#include <memory>
#include <mutex>
#include <optional>
#include <utility>

#include "service/answers.h"
#include "service/fill_workload.h"
#include "service/job_settings.h"
#include "service/limits.h"
#include "service/names.h"
#include "service/work_trace.h"

namespace fogbank::service {

namespace {

/// Lives as long as gRPC or the pump needs it. At most one write is outstanding; the stream is finished only
/// when none is.
class FillStream final : public grpc::ServerWriteReactor<v1::FillCacheResponse>,
                         public PumpedStream,
                         public std::enable_shared_from_this<FillStream> {
 public:
  FillStream(grpc::CallbackServerContext& context, const v1::FillCacheRequest& request,
             FillServices& services)
      : context_(context),
        request_(request),
        services_(services),
        trace_(services.traces, client_trace(context), "fill_cache",
               {{"fogbank.scene", request.scene().substr(0, limits::max_path_bytes)}}) {}

  void start() {
    self_ = shared_from_this();
    trace_.begin("load");
    services_.pump.add(self_);
    const bool posted = services_.control.post([self = shared_from_this()] { self->acquire(); });
    if (!posted) leave_failure(std::make_exception_ptr(shutting_down()));
  }

  void refuse(const grpc::Status& status) {
    self_ = shared_from_this();
    Finish(status);
  }

  Step step() override {
    std::shared_ptr<FillWorkload> workload;
    {
      const std::lock_guard lock(mutex_);
      if (finished_) return {.state = State::finished, .retry_at = {}};
      workload = workload_;
      if ((cancelled_ || services_.shutting_down) && !failure_) failure_ = cancel_status();
      if (failure_ && workload) {
        workload->cancel();
        workload_ = nullptr;
      }
      if (writing_) return {.state = State::writing, .retry_at = {}};
      if (failure_ || last_written_) return finish(failure_.value_or(grpc::Status::OK));
      if (!workload) return {.state = State::waiting, .retry_at = Clock::time_point::max()};
    }
    if (const std::exception_ptr failure = workload->job().failure()) {
      const std::lock_guard lock(mutex_);
      return finish(status_of(failure));
    }
    const render::FillProgress progress = workload->job().progress();
    const Clock::time_point now = Clock::now();
    {
      const std::lock_guard lock(mutex_);
      const bool done = progress.ended && kept_epoch_;
      if (!done && now < next_report_) return {.state = State::waiting, .retry_at = next_report_};
      next_report_ = now + seconds(limits::progress_interval_seconds);
      describe(progress);
      if (done) response_.set_epoch(*kept_epoch_);
      response_.set_done(done);
      writing_ = true;
      last_written_ = done;
      write_start_ = now;
    }
    StartWrite(&response_);
    return {.state = State::writing, .retry_at = {}};
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
    leave_news([this] { cancelled_ = true; });
  }

  void OnDone() override { self_.reset(); }

 private:
  template <typename Change>
  void leave_news(Change change) {
    {
      const std::lock_guard lock(mutex_);
      change();
    }
    services_.pump.ready(shared_from_this());
  }

  void leave_failure(const std::exception_ptr& failure) {
    leave_news([&] { failure_ = status_of(failure); });
  }

  void acquire() {
    try {
      services_.quota.require_cache(0);
      services_.scenes.acquire(parse_scene_name(request_.scene()),
                               [self = shared_from_this()](std::shared_ptr<const transport::World> world,
                                                           double, const std::exception_ptr& error) {
                                 if (error) {
                                   self->leave_failure(error);
                                   return;
                                 }
                                 // Not in the loader's thread, for which scenes may wait.
                                 const bool posted =
                                     self->services_.control.post([self, world = std::move(world)] {
                                       try {
                                         self->begin(world);
                                       } catch (...) {
                                         self->leave_failure(std::current_exception());
                                       }
                                     });
                                 if (!posted) self->leave_failure(std::make_exception_ptr(shutting_down()));
                               });
    } catch (...) {
      leave_failure(std::current_exception());
    }
  }

  void begin(const std::shared_ptr<const transport::World>& world) {
    FillSettings settings = resolve_fill(request_, world->scene(), services_.scheduler.threads());
    field_ = cache::record_field(world->scene(), settings.engine.integrator_settings.max_depth);
    settings.engine.integrator_settings.cache = services_.caches.acquire(field_);
    auto workload = std::make_shared<FillWorkload>(
        services_.scheduler, services_.group,
        std::make_unique<render::FillJob>(world, settings.engine, std::move(settings.cameras)),
        [stream = weak_from_this()] {
          if (const auto self = stream.lock()) self->save();
        });
    leave_news([&] {
      if (cancelled_ || failure_) return;
      trace_.end("load");
      trace_.begin("fill");
      workload->start();
      workload_ = std::move(workload);
    });
  }

  /// Keeps what was made. Called by a render thread, which is not to wait for the disk.
  void save() {
    {
      const std::lock_guard lock(mutex_);
      trace_.end("fill");
      trace_.begin("save");
    }
    const bool posted = services_.control.post([self = shared_from_this()] {
      try {
        const uint64_t epoch = self->services_.caches.keep_epoch(self->field_);
        self->leave_news([&] {
          self->trace_.end("save", {{"fogbank.epoch", static_cast<int64_t>(epoch)}});
          self->kept_epoch_ = epoch;
        });
      } catch (...) {
        self->leave_failure(std::current_exception());
      }
    });
    if (!posted) leave_failure(std::make_exception_ptr(shutting_down()));
  }

  /// With `mutex_` held.
  void describe(const render::FillProgress& progress) {
    response_.set_cameras_done(static_cast<int32_t>(progress.cameras_done));
    response_.set_cameras_total(static_cast<int32_t>(progress.camera_count));
    response_.set_fraction(progress.ended ? 1 : progress.fraction);
    response_.set_records_reused(progress.records_reused);
    response_.set_records_new(progress.records_new);
    response_.set_epoch(progress.epoch);
    response_.set_rays(progress.rays);
    response_.set_elapsed_seconds(progress.seconds);
    response_.set_cache(cache_name(field_.transport));
  }

  /// With `mutex_` held and no write outstanding.
  Step finish(const grpc::Status& status) {
    finished_ = true;
    trace_.finish({{"rpc.grpc.status_code", static_cast<int64_t>(status.error_code())},
                   {"fogbank.records_new", static_cast<int64_t>(response_.records_new())},
                   {"fogbank.rays", static_cast<int64_t>(response_.rays())}},
                  !status.ok());
    workload_ = nullptr;  // and with it the cache, before the client hears of the end
    Finish(status);
    return {.state = State::finished, .retry_at = {}};
  }

  grpc::Status cancel_status() const {
    if (services_.shutting_down) return shutting_down_status();
    if (!stalled_) return grpc::Status::CANCELLED;
    return to_grpc_status(
        {grpc::StatusCode::ABORTED, "FILL_STALLED", "the client read nothing for too long"});
  }

  grpc::CallbackServerContext& context_;
  const v1::FillCacheRequest request_;
  FillServices& services_;
  std::shared_ptr<FillStream> self_;  ///< until OnDone
  scene::FieldIdentity field_;        ///< set before `workload_`
  v1::FillCacheResponse response_;    ///< of the outstanding write
  Clock::time_point next_report_;     ///< of the pump's thread

  std::mutex mutex_;
  WorkTrace trace_;
  std::shared_ptr<FillWorkload> workload_;
  std::optional<uint64_t> kept_epoch_;
  std::optional<grpc::Status> failure_;
  bool writing_ = false;
  bool cancelled_ = false;
  bool stalled_ = false;
  bool last_written_ = false;
  bool finished_ = false;
  Clock::time_point write_start_;
};

}  // namespace

grpc::ServerWriteReactor<v1::FillCacheResponse>* start_fill(grpc::CallbackServerContext& context,
                                                            const v1::FillCacheRequest& request,
                                                            FillServices& services) {
  const auto stream = std::make_shared<FillStream>(context, request, services);
  if (services.shutting_down) {
    stream->refuse(shutting_down_status());
  } else if (services.pump.streams() >= static_cast<size_t>(limits::max_fills)) {
    stream->refuse(to_grpc_status({grpc::StatusCode::RESOURCE_EXHAUSTED,
                                   "TOO_MANY_FILLS",
                                   "too many FillCache streams are open",
                                   {{"limit", "max_fills"}}}));
  } else {
    try {
      services.quota.require_cpu();
      stream->start();
    } catch (...) {
      stream->refuse(status_of(std::current_exception()));
    }
  }
  return stream.get();
}

}  // namespace fogbank::service
