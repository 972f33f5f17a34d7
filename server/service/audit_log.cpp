#include "service/audit_log.h"

#include <google/protobuf/util/time_util.h>
#include <spdlog/sinks/rotating_file_sink.h>
#include <spdlog/spdlog.h>

#include <nlohmann/json.hpp>

#include "service/messages.h"

namespace fogbank::service {

namespace {
constexpr size_t file_bytes = 16 << 20;
constexpr size_t most_files = 8;
constexpr size_t most_peer_bytes = 100;
}  // namespace

AuditLog::AuditLog(const std::filesystem::path& path)
    : logger_(std::make_unique<spdlog::logger>(
          "audit", std::make_shared<spdlog::sinks::rotating_file_sink_mt>(path, file_bytes, most_files))) {
  logger_->set_pattern("%v");
  logger_->flush_on(spdlog::level::info);
}

AuditLog::~AuditLog() = default;

void AuditLog::record(std::string_view rpc, std::string_view outcome, const std::string& peer,
                      const Identity* identity) {
  nlohmann::ordered_json line = {
      {"time", google::protobuf::util::TimeUtil::ToString(timestamp_now())},
      {"rpc", rpc},
      {"outcome", outcome},
      {"peer", peer.substr(0, most_peer_bytes)},
  };
  if (identity != nullptr) {
    line["tenant"] = identity->tenant;
    line["by"] = identity->by;
  }
  logger_->info("{}", line.dump(-1, ' ', true, nlohmann::json::error_handler_t::replace));
}

}  // namespace fogbank::service
