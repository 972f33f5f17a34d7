// Spans of time in what the server does, for tools that show them.
#pragma once

#include <spdlog/fwd.h>

#include <chrono>
#include <cstdint>
#include <filesystem>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <variant>

namespace fogbank::service {

/// Where a span belongs: W3C Trace Context (https://www.w3.org/TR/trace-context/), version 00.
struct TraceContext {
  std::string trace_id;  ///< 32 lower-case hexadecimal digits
  std::string span_id;   ///< 16, of the parent; empty: there is none
  bool sampled = true;   ///< the caller wants to see it
};

/// "00-{trace id}-{span id}-{flags}"; nullopt for anything else, as the specification has it.
std::optional<TraceContext> parse_traceparent(std::string_view text);

/// A context of its own, without a parent.
TraceContext new_trace();
std::string new_span_id();

/// One line of a trace.
struct Span {
  using Time = std::chrono::system_clock::time_point;
  using Value = std::variant<int64_t, double, std::string>;

  TraceContext parent;
  std::string id;  ///< 16 hexadecimal digits
  std::string name;
  Time begin;
  Time end;
  std::map<std::string, Value> attributes;
  bool failed = false;
};

/// A file of OTLP/JSON: each line is one ExportTraceServiceRequest of OpenTelemetry's protocol 1.x, which its
/// collector's file receiver reads. 64 MiB a file, four files. Thread-safe.
class TraceLog {
 public:
  /// Throws OptionError for a file that can't be written.
  explicit TraceLog(const std::filesystem::path& path);
  ~TraceLog();

  /// On the disk within a second. Nothing happens to a span that the caller doesn't want.
  void write(const Span& span);

 private:
  std::unique_ptr<spdlog::logger> logger_;
};

}  // namespace fogbank::service
