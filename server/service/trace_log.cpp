#include "service/trace_log.h"

#include <openssl/rand.h>
#include <spdlog/sinks/rotating_file_sink.h>
#include <spdlog/spdlog.h>

#include <algorithm>
#include <array>
#include <nlohmann/json.hpp>
#include <type_traits>

#include "service/server.h"

namespace fogbank::service {

namespace {

constexpr size_t file_bytes = 64 << 20;
constexpr size_t most_files = 4;

bool is_hexadecimal(std::string_view text) {
  return text.find_first_not_of("0123456789abcdef") == std::string_view::npos;
}

bool is_zero(std::string_view text) { return text.find_first_not_of('0') == std::string_view::npos; }

template <size_t bytes>
std::string random_digits() {
  std::array<unsigned char, bytes> random{};
  RAND_bytes(random.data(), static_cast<int>(random.size()));
  std::string digits;
  for (const unsigned char byte : random) {
    digits += "0123456789abcdef"[byte >> 4];
    digits += "0123456789abcdef"[byte & 15];
  }
  return digits;
}

/// OTLP/JSON writes 64-bit integers as text.
std::string nanoseconds(Span::Time time) {
  return std::to_string(
      std::chrono::duration_cast<std::chrono::nanoseconds>(time.time_since_epoch()).count());
}

nlohmann::ordered_json attribute(const std::string& key, const Span::Value& value) {
  nlohmann::ordered_json any;
  std::visit(
      [&](const auto& alternative) {
        using Type = std::decay_t<decltype(alternative)>;
        if constexpr (std::is_same_v<Type, int64_t>) {
          any["intValue"] = std::to_string(alternative);
        } else if constexpr (std::is_same_v<Type, double>) {
          any["doubleValue"] = alternative;
        } else {
          any["stringValue"] = alternative;
        }
      },
      value);
  return {{"key", key}, {"value", any}};
}

}  // namespace

std::optional<TraceContext> parse_traceparent(std::string_view text) {
  constexpr size_t length = 55;
  if (text.size() != length || !text.starts_with("00-") || text[35] != '-' || text[52] != '-') return {};
  const std::string_view trace = text.substr(3, 32);
  const std::string_view span = text.substr(36, 16);
  const std::string_view flags = text.substr(53, 2);
  if (!is_hexadecimal(trace) || !is_hexadecimal(span) || !is_hexadecimal(flags)) return {};
  if (is_zero(trace) || is_zero(span)) return {};
  // The lowest bit of the flags: odd digits.
  const bool sampled = std::string_view("13579bdf").find(flags[1]) != std::string_view::npos;
  return TraceContext{.trace_id = std::string(trace), .span_id = std::string(span), .sampled = sampled};
}

TraceContext new_trace() { return {.trace_id = random_digits<16>(), .span_id = "", .sampled = true}; }

std::string new_span_id() { return random_digits<8>(); }

TraceLog::TraceLog(const std::filesystem::path& path) {
  try {
    logger_ = std::make_unique<spdlog::logger>(
        "trace", std::make_shared<spdlog::sinks::rotating_file_sink_mt>(path, file_bytes, most_files));
  } catch (const spdlog::spdlog_ex& error) {
    throw OptionError("--trace: " + std::string(error.what()));
  }
  logger_->set_pattern("%v");
  logger_->flush_on(spdlog::level::info);
}

TraceLog::~TraceLog() = default;

void TraceLog::write(const Span& span) {
  if (!span.parent.sampled) return;
  nlohmann::ordered_json message = {{"traceId", span.parent.trace_id}, {"spanId", span.id}};
  if (!span.parent.span_id.empty()) message["parentSpanId"] = span.parent.span_id;
  message["name"] = span.name;
  message["kind"] = 2;  // of a server
  message["startTimeUnixNano"] = nanoseconds(span.begin);
  message["endTimeUnixNano"] = nanoseconds(std::max(span.begin, span.end));
  for (const auto& [key, value] : span.attributes) message["attributes"].push_back(attribute(key, value));
  if (span.failed) message["status"] = {{"code", 2}};
  const nlohmann::ordered_json resource = {
      {"attributes", {attribute("service.name", "fogbankd"), attribute("service.version", FOGBANK_VERSION)}}};
  const nlohmann::ordered_json scope = {{"scope", {{"name", "fogbank"}}}, {"spans", {message}}};
  const nlohmann::ordered_json request = {
      {"resourceSpans", {{{"resource", resource}, {"scopeSpans", {scope}}}}}};
  logger_->info("{}", request.dump(-1, ' ', true, nlohmann::json::error_handler_t::replace));
}

}  // namespace fogbank::service
