// The PerformTasks rpc: tasks of a replica on the render threads, results as they come.
#pragma once

#include <grpcpp/grpcpp.h>

#include <atomic>
#include <memory>

#include "fogbank/v1/farm.pb.h"
#include "service/replica_table.h"
#include "service/scheduling/scheduler.h"
#include "service/stream_pump.h"

namespace fogbank::service {

struct PerformServices {
  Scheduler& scheduler;
  StreamPump& pump;
  int group = 0;  ///< of the scheduler
  std::atomic<bool> shutting_down = false;
};

/// Throws RpcError as PerformTasks refuses requests.
grpc::ServerWriteReactor<v1::PerformTasksResponse>* start_performing(grpc::CallbackServerContext& context,
                                                                     const v1::PerformTasksRequest& request,
                                                                     ReplicaTable& replicas,
                                                                     PerformServices& services);

}  // namespace fogbank::service
