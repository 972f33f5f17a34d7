// The server's log for programs.
#pragma once

#include <spdlog/formatter.h>

#include <memory>

namespace fogbank::service {

/// One JSON object a line: time (UTC, RFC 3339), level, thread, message; control characters of names that
/// clients chose are escaped.
class JsonFormatter final : public spdlog::formatter {
 public:
  void format(const spdlog::details::log_msg& message, spdlog::memory_buf_t& line) override;
  std::unique_ptr<formatter> clone() const override { return std::make_unique<JsonFormatter>(); }
};

}  // namespace fogbank::service
