#include "service/probe_stream.h"

#include <cmath>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <utility>

#include "service/answers.h"
#include "service/limits.h"
#include "service/names.h"
#include "service/probe_messages.h"
#include "service/probe_settings.h"
#include "service/probe_workload.h"
#include "service/work_trace.h"

namespace fogbank::service {

using grpc::StatusCode;

namespace {

RpcError invalid_probe(const std::string& message) {
  return {StatusCode::INVALID_ARGUMENT, "INVALID_PROBE", message};
}

/// The points of a chunk, the first of which is number `first` of the stream.
std::vector<Vec3f> checked_points(const v1::ProbePoints& message, uint64_t first) {
  const int size = message.coordinates_size();
  if (size == 0) throw invalid_probe("a chunk without points");
  if (size > 3 * limits::max_probe_chunk_points) {
    throw RpcError(StatusCode::INVALID_ARGUMENT, "CHUNK_TOO_LARGE",
                   "a chunk of " + std::to_string(size / 3) + " points; at most " +
                       std::to_string(limits::max_probe_chunk_points) + " are allowed",
                   {{"limit", "max_probe_chunk_points"}});
  }
  const auto refuse = [&](int point, const std::string& why) {
    const std::string field = "points[" + std::to_string(first + static_cast<uint64_t>(point)) + "]";
    throw RpcError(StatusCode::INVALID_ARGUMENT, "INVALID_POINT", field + ": " + why, {{"field", field}});
  };
  if (size % 3 != 0) refuse(size / 3, "needs x, y and z");
  std::vector<Vec3f> points;
  points.reserve(static_cast<size_t>(size / 3));
  for (int i = 0; i < size / 3; ++i) {
    Vec3f point;
    for (int axis = 0; axis < 3; ++axis) {
      const double coordinate = message.coordinates(3 * i + axis);
      point[axis] = static_cast<float>(coordinate);
      if (!std::isfinite(coordinate)) refuse(i, "a coordinate is not finite");
      if (!std::isfinite(point[axis])) refuse(i, "a coordinate is beyond the range of 32-bit floats");
    }
    points.push_back(point);
  }
  return points;
}

/// Lives as long as gRPC or the pump needs it. At most one read and one write are outstanding; the stream is
/// finished only when no write is. All decisions are the pump's thread's, everybody else only leaves news.
class ProbeStream final : public ProbeReactor,
                          public PumpedStream,
                          public std::enable_shared_from_this<ProbeStream> {
 public:
  ProbeStream(grpc::CallbackServerContext& context, ProbeServices& services)
      : context_(context), services_(services) {}

  void start() {
    self_ = shared_from_this();
    services_.pump.add(self_);
  }

  void refuse(const grpc::Status& status) {
    self_ = shared_from_this();
    Finish(status);
  }

  Step step() override {
    News news;
    bool cancelled = false;
    bool half_closed = false;
    {
      const std::lock_guard lock(mutex_);
      if (finished_) return {.state = State::finished, .retry_at = {}};
      news = std::exchange(news_, News());
      cancelled = cancelled_;
      half_closed = half_closed_;
    }
    if (!cancelled && !failure_) {
      try {
        advance(news, half_closed);
      } catch (...) {
        failure_ = status_of(std::current_exception());
      }
    }
    const bool over = cancelled || failure_;
    if (over && workload_) workload_->cancel();

    bool write = false;
    bool read = false;
    {
      const std::lock_guard lock(mutex_);
      if (writing_) return {.state = State::writing, .retry_at = {}};
      if (cancelled_) return finish(cancel_status());
      if (failure_) return finish(*failure_);
      write = next_response();
      if (!write && half_closed && begun_ && points_in_flight() == 0) return finish(grpc::Status::OK);
      // A message that came since `news` was taken lies in `request_` until the next step.
      read = !reading_ && !half_closed_ && !news_.message && wants_message();
      reading_ = reading_ || read;
      writing_ = write;
      if (read || write) last_progress_ = Clock::now();
    }
    if (read) StartRead(&request_);
    if (write) StartWrite(&response_);
    return {.state = write ? State::writing : State::waiting, .retry_at = Clock::time_point::max()};
  }

  void check_stall(Clock::time_point now) override {
    {
      const std::lock_guard lock(mutex_);
      const bool waits_for_client = writing_ || (reading_ && points_in_flight() == 0);
      if (finished_ || stalled_ || !waits_for_client) return;
      if (now - last_progress_ < seconds(limits::probe_stall_seconds)) return;
      stalled_ = true;
    }
    // As for watchers: such a write never fails by itself, and the context lives until the stream is
    // finished.
    context_.TryCancel();
  }

  void OnReadDone(bool ok) override {
    leave_news([this, ok] {
      reading_ = false;
      last_progress_ = Clock::now();
      (ok ? news_.message : half_closed_) = true;
    });
  }

  void OnWriteDone(bool ok) override {
    leave_news([this, ok] {
      writing_ = false;
      last_progress_ = Clock::now();
      if (!ok) cancelled_ = true;
    });
  }

  void OnCancel() override {
    leave_news([this] { cancelled_ = true; });
  }

  void OnDone() override { self_.reset(); }

 private:
  /// What happened since the last step.
  struct News {
    bool message = false;  ///< `request_` holds one; none is being read
    std::shared_ptr<const transport::World> world;
    std::exception_ptr load_error;
  };

  template <typename Change>
  void leave_news(Change change) {
    {
      const std::lock_guard lock(mutex_);
      change();
    }
    services_.pump.ready(shared_from_this());
  }

  void advance(News& news, bool half_closed) {
    if (services_.shutting_down) throw shutting_down();
    if (news.load_error) std::rethrow_exception(news.load_error);
    if (news.message) take_message();
    if (half_closed && !header_seen_) throw invalid_probe("there was no header");
    if (news.world) begin(std::move(news.world));
    if (!workload_) return;
    if (const std::exception_ptr failure = workload_->job().failure()) std::rethrow_exception(failure);
  }

  void take_message() {
    if (request_.has_header() == header_seen_)
      throw invalid_probe(header_seen_ ? "a second header" : "the first message must be the header");
    if (request_.has_header()) {
      header_seen_ = true;
      const std::string& scene = request_.header().scene();
      trace_.emplace(services_.traces, client_trace(context_), "probe",
                     WorkTrace::Attributes{{"fogbank.scene", scene.substr(0, limits::max_path_bytes)}});
      trace_->begin("load");
      settings_ = request_.header().settings();
      acquire(parse_scene_name(scene));
    } else {
      std::vector<Vec3f> points = checked_points(request_.points(), points_received_);
      points_received_ += points.size();
      workload_->add(std::move(points));
    }
  }

  void acquire(const std::string& scene) {
    const bool posted = services_.control.post([self = shared_from_this(), scene] {
      const auto answer = [self](std::shared_ptr<const transport::World> world, std::exception_ptr error) {
        self->leave_news([&] {
          self->news_.world = std::move(world);
          self->news_.load_error = std::move(error);
        });
      };
      try {
        self->services_.scenes.acquire(
            scene, [answer](std::shared_ptr<const transport::World> world, double, std::exception_ptr error) {
              answer(std::move(world), std::move(error));
            });
      } catch (...) {
        answer(nullptr, std::current_exception());
      }
    });
    if (!posted) throw shutting_down();
  }

  void begin(std::shared_ptr<const transport::World> world) {
    ResolvedProbe resolved = resolve_probe(settings_, world->scene());
    derivatives_ = resolved.engine.derivatives;
    v1::ProbeStarted& started = *response_.mutable_started();
    for (const scene::Medium& medium : world->scene().media) started.add_media(medium.id);
    auto make = [world, method = resolved.effective.method(), settings = resolved.engine] {
      return derivatives::make_estimator(method, world, settings);
    };
    *started.mutable_settings() = std::move(resolved.effective);
    workload_ = std::make_shared<ProbeWorkload>(
        services_.scheduler, services_.group,
        std::make_unique<render::ProbeJob>(std::move(world), resolved.engine, std::move(make)),
        [stream = weak_from_this(), &pump = services_.pump] {
          if (const auto self = stream.lock()) pump.ready(self);
        });
    trace_->end("load");
    trace_->begin("points");
  }

  /// Fills `response_` if there is something to write; nothing is being written.
  bool next_response() {
    if (!workload_) return false;
    if (!begun_) {
      begun_ = true;  // `begin` has filled it
      return true;
    }
    const auto results = workload_->job().take_results();
    if (!results) return false;
    set_results(*response_.mutable_results(), points_answered_, *results, derivatives_);
    points_answered_ += results->size();
    return true;
  }

  size_t points_in_flight() const { return workload_ ? workload_->job().points_in_flight() : 0; }

  /// The header at once, points once there is something to do with them and while there is room.
  bool wants_message() const {
    if (!header_seen_) return true;
    return workload_ && static_cast<int64_t>(points_in_flight()) + limits::max_probe_chunk_points <=
                            limits::max_probe_points_in_flight;
  }

  /// With `mutex_` held and no write outstanding.
  Step finish(const grpc::Status& status) {
    finished_ = true;
    if (trace_) {
      trace_->end("points", {{"fogbank.points", static_cast<int64_t>(points_answered_)}});
      trace_->finish({{"rpc.grpc.status_code", static_cast<int64_t>(status.error_code())}}, !status.ok());
    }
    Finish(status);
    return {.state = State::finished, .retry_at = {}};
  }

  grpc::Status cancel_status() const {
    if (!stalled_) return grpc::Status::CANCELLED;
    return to_grpc_status({StatusCode::ABORTED, "PROBE_STALLED", "the client did nothing for too long"});
  }

  grpc::CallbackServerContext& context_;
  ProbeServices& services_;
  std::shared_ptr<ProbeStream> self_;  ///< until OnDone

  // Of the pump's thread.
  bool header_seen_ = false;
  bool begun_ = false;  ///< `started` was written
  v1::ProbeSettings settings_;
  derivatives::DerivativeOrder derivatives_ = derivatives::DerivativeOrder::hessian;
  std::shared_ptr<ProbeWorkload> workload_;
  uint64_t points_received_ = 0;
  uint64_t points_answered_ = 0;
  std::optional<grpc::Status> failure_;
  std::optional<WorkTrace> trace_;  ///< from the header on
  v1::ProbeRequest request_;        ///< of the outstanding read, or the message that it brought
  v1::ProbeResponse response_;      ///< of the outstanding write

  std::mutex mutex_;
  News news_;
  bool half_closed_ = false;
  bool cancelled_ = false;
  bool reading_ = false;
  bool writing_ = false;
  bool stalled_ = false;
  bool finished_ = false;
  Clock::time_point last_progress_ = Clock::now();
};

}  // namespace

ProbeReactor* start_probe(grpc::CallbackServerContext& context, ProbeServices& services) {
  const auto stream = std::make_shared<ProbeStream>(context, services);
  if (services.shutting_down) {
    stream->refuse(shutting_down_status());
  } else if (services.pump.streams() >= static_cast<size_t>(limits::max_probes)) {
    stream->refuse(to_grpc_status({StatusCode::RESOURCE_EXHAUSTED,
                                   "TOO_MANY_PROBES",
                                   "too many Probe streams are open",
                                   {{"limit", "max_probes"}}}));
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
