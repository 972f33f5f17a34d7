// The spans of one job.
#pragma once

#include <map>
#include <optional>
#include <string>

#include "service/trace_log.h"

namespace fogbank::service {

/// One span for the job and, below it, one for each part of its life: "queue", "load", "fill" (the work of an
/// integrator between passes), "tiles" (a pass), "encode", "send" (a watcher). Not thread-safe.
class JobTrace {
 public:
  /// `log` null: nothing is written. Without the client's context the job is a trace of its own.
  JobTrace(TraceLog* log, std::optional<TraceContext> client, std::string job);

  /// Does nothing where the part goes on already.
  void begin(const std::string& part);
  /// Does nothing where the part hasn't begun.
  void end(const std::string& part, std::map<std::string, Span::Value> attributes = {});
  /// A part that took so long until now; none for 0.
  void add(const std::string& part, double seconds);
  /// The job has ended, and with it all its parts.
  void finish(const std::string& state, bool failed);

  /// What parts that others measure belong to; nullopt where nothing is written.
  std::optional<TraceContext> context() const;
  TraceLog* log() const { return log_; }

 private:
  TraceLog* log_;
  TraceContext parent_;
  const std::string job_;
  const std::string id_;
  const Span::Time begin_;
  std::map<std::string, Span::Time> parts_;  ///< that go on
  bool finished_ = false;
};

}  // namespace fogbank::service
