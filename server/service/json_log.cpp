#include "service/json_log.h"

#include <google/protobuf/util/time_util.h>
#include <spdlog/details/log_msg.h>

#include <chrono>
#include <nlohmann/json.hpp>
#include <string>
#include <string_view>

namespace fogbank::service {

void JsonFormatter::format(const spdlog::details::log_msg& message, spdlog::memory_buf_t& line) {
  using google::protobuf::util::TimeUtil;
  const auto since_1970 =
      std::chrono::duration_cast<std::chrono::nanoseconds>(message.time.time_since_epoch()).count();
  const auto view = [](const spdlog::string_view_t& text) {
    return std::string_view(text.data(), text.size());
  };
  const nlohmann::ordered_json object = {
      {"time", TimeUtil::ToString(TimeUtil::NanosecondsToTimestamp(since_1970))},
      {"level", view(spdlog::level::to_string_view(message.level))},
      {"thread", message.thread_id},
      {"message", view(message.payload)},
  };
  const std::string text = object.dump(-1, ' ', true, nlohmann::json::error_handler_t::replace) + "\n";
  line.append(text.data(), text.data() + text.size());
}

}  // namespace fogbank::service
