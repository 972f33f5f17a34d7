// fogbank.v1.FarmService.
#pragma once

#include "fogbank/v1/farm.grpc.pb.h"
#include "service/scheduling/scheduler.h"
#include "service/scheduling/task_queue.h"
#include "service/tenants.h"

namespace fogbank::service {

class FarmServiceImplementation final : public v1::FarmService::CallbackService {
 public:
  /// `control` answers the short calls, `files` does what may take long.
  FarmServiceImplementation(Tenants& tenants, TaskQueue& control, TaskQueue& files, Scheduler& scheduler)
      : tenants_(tenants), control_(control), files_(files), scheduler_(scheduler) {}

  grpc::ServerUnaryReactor* LeaseTasks(grpc::CallbackServerContext* context,
                                       const v1::LeaseTasksRequest* request,
                                       v1::LeaseTasksResponse* response) override;
  grpc::ServerReadReactor<v1::CompleteTasksRequest>* CompleteTasks(
      grpc::CallbackServerContext* context, v1::CompleteTasksResponse* response) override;
  grpc::ServerUnaryReactor* ReadJobLog(grpc::CallbackServerContext* context,
                                       const v1::ReadJobLogRequest* request,
                                       v1::ReadJobLogResponse* response) override;
  grpc::ServerUnaryReactor* OpenReplica(grpc::CallbackServerContext* context,
                                        const v1::OpenReplicaRequest* request,
                                        v1::OpenReplicaResponse* response) override;
  grpc::ServerUnaryReactor* AdvanceReplica(grpc::CallbackServerContext* context,
                                           const v1::AdvanceReplicaRequest* request,
                                           v1::AdvanceReplicaResponse* response) override;
  grpc::ServerWriteReactor<v1::PerformTasksResponse>* PerformTasks(
      grpc::CallbackServerContext* context, const v1::PerformTasksRequest* request) override;
  grpc::ServerUnaryReactor* CloseReplica(grpc::CallbackServerContext* context,
                                         const v1::CloseReplicaRequest* request,
                                         v1::CloseReplicaResponse* response) override;

 private:
  Tenants& tenants_;
  TaskQueue& control_;
  TaskQueue& files_;
  Scheduler& scheduler_;
};

}  // namespace fogbank::service
