// fogbank.v1.ProbeService.
#pragma once

#include "fogbank/v1/probe.grpc.pb.h"
#include "service/scheduling/task_queue.h"
#include "service/tenants.h"

namespace fogbank::service {

class ProbeServiceImplementation final : public v1::ProbeService::CallbackService {
 public:
  /// `control` answers the short calls.
  ProbeServiceImplementation(Tenants& tenants, TaskQueue& control) : tenants_(tenants), control_(control) {}

  ProbeReactor* Probe(grpc::CallbackServerContext* context) override;
  grpc::ServerUnaryReactor* GetPlan(grpc::CallbackServerContext* context, const v1::GetPlanRequest* request,
                                    v1::GetPlanResponse* response) override;

 private:
  Tenants& tenants_;
  TaskQueue& control_;
};

}  // namespace fogbank::service
