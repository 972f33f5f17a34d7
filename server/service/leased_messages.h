// Leased tasks and their results, between engine and wire.
#pragma once

#include "fogbank/v1/farm.pb.h"
#include "render/leased_task.h"
#include "service/rpc_error.h"

namespace fogbank::service {

void set_task(v1::LeasedTask& message, render::LeasedTask&& task);
render::LeasedTask to_task(const v1::LeasedTask& message);
/// What a result's last part says beside the bytes. Throws RpcError INVALID_RESULT for times that are not
/// finite or negative.
render::TaskResult to_result(const v1::TaskResultPart& last_part, std::string bytes);
/// The next part of a result, from `offset` on.
void set_part(v1::TaskResultPart& part, const render::LeasedTask& task, const render::TaskResult& result,
              size_t offset);

/// What the engine says of a replica that lacks entries of the log, with what a client needs to go on; other
/// errors as they are.
RpcError with_log_length(const RpcError& error, uint64_t length);

}  // namespace fogbank::service
