// The LeaseTasks rpc: a call that waits for tasks.
#pragma once

#include <grpcpp/grpcpp.h>

#include "fogbank/v1/farm.pb.h"
#include "service/scheduling/task_queue.h"
#include "service/tenants.h"

namespace fogbank::service {

/// Counts as a stream of the tenant's job watchers.
grpc::ServerUnaryReactor* start_lease(grpc::CallbackServerContext& context,
                                      const v1::LeaseTasksRequest& request, v1::LeaseTasksResponse& response,
                                      Tenants& tenants, TaskQueue& control);

}  // namespace fogbank::service
