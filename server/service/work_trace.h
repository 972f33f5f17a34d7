// The spans of one job, fill or probe.
#pragma once

#include <grpcpp/server_context.h>

#include <map>
#include <optional>
#include <string>

#include "service/trace_log.h"

namespace fogbank::service {

/// What the client's `traceparent` says; nullopt where there is none, or nonsense.
std::optional<TraceContext> client_trace(const grpc::CallbackServerContext& context);

/// One span for the work and, below it, one for each part of its life. Of a job ("job"): "queue", "load",
/// "fill" (the work of an integrator between passes), "tiles" (a pass), "encode", "send" (a watcher). Of
/// FillCache
/// ("fill_cache"): "load", "fill", "save". Of Probe ("probe"): "load", "points". Not thread-safe.
class WorkTrace {
 public:
  using Attributes = std::map<std::string, Span::Value>;

  /// `log` null: nothing is written. Without the client's context the work is a trace of its own. All spans
  /// have the attributes `subject`.
  WorkTrace(TraceLog* log, std::optional<TraceContext> client, std::string name, Attributes subject);

  /// Does nothing where the part goes on already.
  void begin(const std::string& part);
  /// Does nothing where the part hasn't begun.
  void end(const std::string& part, Attributes attributes = {});
  /// A part that took so long until now; none for 0.
  void add(const std::string& part, double seconds);
  /// The work has ended, and with it all its parts.
  void finish(Attributes attributes, bool failed);

  /// What parts that others measure belong to; nullopt where nothing is written.
  std::optional<TraceContext> context() const;
  TraceLog* log() const { return log_; }

 private:
  TraceLog* log_;
  TraceContext parent_;
  const std::string name_;
  const Attributes subject_;
  const std::string id_;
  const Span::Time begin_;
  std::map<std::string, Span::Time> parts_;  ///< that go on
  bool finished_ = false;
};

}  // namespace fogbank::service
