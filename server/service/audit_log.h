// Who did what, for the operator.
#pragma once

#include <spdlog/fwd.h>

#include <filesystem>
#include <memory>
#include <string>
#include <string_view>

#include "service/token_file.h"

namespace fogbank::service {

/// One JSON object a line: time, rpc, outcome ("allowed" or the reason of the refusal), peer, and, where they
/// are known, tenant and token id. Whatever a caller can choose is escaped and cut. 16 MiB a file, eight
/// files. Thread-safe.
class AuditLog {
 public:
  explicit AuditLog(const std::filesystem::path& path);
  ~AuditLog();

  /// `identity` null: unknown.
  void record(std::string_view rpc, std::string_view outcome, const std::string& peer,
              const Identity* identity);

 private:
  std::unique_ptr<spdlog::logger> logger_;
};

}  // namespace fogbank::service
