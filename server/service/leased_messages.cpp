#include "service/leased_messages.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "service/limits.h"

namespace fogbank::service {

void set_task(v1::LeasedTask& message, render::LeasedTask&& task) {
  message.set_stage(task.stage);
  message.set_index(task.index);
  switch (task.kind) {
    case render::LeasedKind::preparation:
      message.set_kind(v1::TASK_KIND_PREPARATION);
      break;
    case render::LeasedKind::survey:
      message.set_kind(v1::TASK_KIND_SURVEY);
      break;
    case render::LeasedKind::tile:
      message.set_kind(v1::TASK_KIND_TILE);
      break;
  }
  message.set_input(std::move(task.input));
}

render::LeasedTask to_task(const v1::LeasedTask& message) {
  render::LeasedTask task{
      .stage = message.stage(), .index = message.index(), .kind = {}, .input = message.input()};
  task.kind = message.kind() == v1::TASK_KIND_PREPARATION ? render::LeasedKind::preparation
              : message.kind() == v1::TASK_KIND_SURVEY    ? render::LeasedKind::survey
                                                          : render::LeasedKind::tile;
  return task;
}

render::TaskResult to_result(const v1::TaskResultPart& last_part, std::string bytes) {
  for (const double time : {last_part.seconds(), last_part.cpu_seconds()}) {
    if (!std::isfinite(time) || time < 0) {
      throw RpcError(grpc::StatusCode::INVALID_ARGUMENT, "INVALID_RESULT",
                     "the time that a task took is negative or not finite");
    }
  }
  return {.bytes = std::move(bytes),
          .rays = last_part.rays(),
          .invalid_samples = last_part.invalid_samples(),
          .seconds = last_part.seconds(),
          .cpu_seconds = last_part.cpu_seconds()};
}

void set_part(v1::TaskResultPart& part, const render::LeasedTask& task, const render::TaskResult& result,
              size_t offset) {
  const size_t size =
      std::min(result.bytes.size() - offset, static_cast<size_t>(limits::max_result_part_bytes));
  part.Clear();
  part.set_stage(task.stage);
  part.set_index(task.index);
  part.set_offset(static_cast<int64_t>(offset));
  part.set_data(result.bytes.substr(offset, size));
  if (offset + size < result.bytes.size()) return;
  part.set_last(true);
  part.set_seconds(result.seconds);
  part.set_cpu_seconds(result.cpu_seconds);
  part.set_rays(result.rays);
  part.set_invalid_samples(result.invalid_samples);
}

RpcError with_log_length(const RpcError& error, uint64_t length) {
  if (error.reason() != "REPLICA_BEHIND") return error;
  return {error.code(), error.reason(), error.what(), {{"log_length", std::to_string(length)}}};
}

}  // namespace fogbank::service
