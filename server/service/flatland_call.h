// The calls of FlatlandService.
#pragma once

#include <grpcpp/grpcpp.h>

#include "fogbank/v1/flatland.pb.h"
#include "service/scheduling/scheduler.h"
#include "service/scheduling/task_queue.h"

namespace fogbank::service {

/// Reactors that delete themselves when the call is done. `control` checks the request, `scheduler` computes,
/// for `group`.
grpc::ServerUnaryReactor* start_flatland_call(const v1::ProbeFlatlandRequest& request,
                                              v1::ProbeFlatlandResponse& response, TaskQueue& control,
                                              Scheduler& scheduler, int group);
grpc::ServerUnaryReactor* start_flatland_call(const v1::FillFlatlandCacheRequest& request,
                                              v1::FillFlatlandCacheResponse& response, TaskQueue& control,
                                              Scheduler& scheduler, int group);

}  // namespace fogbank::service
