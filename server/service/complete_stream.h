// The CompleteTasks rpc: results of leased tasks come in.
#pragma once

#include <grpcpp/grpcpp.h>

#include "fogbank/v1/farm.pb.h"
#include "service/job_table.h"
#include "service/scheduling/task_queue.h"

namespace fogbank::service {

/// Results are decoded in `queue`, one message at a time, so that the client is slowed down by it.
grpc::ServerReadReactor<v1::CompleteTasksRequest>* start_completion(v1::CompleteTasksResponse& response,
                                                                    JobTable& jobs, TaskQueue& queue);

}  // namespace fogbank::service
