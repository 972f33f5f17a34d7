// fogbank.v1.ProbeService.
#pragma once

#include "fogbank/v1/probe.grpc.pb.h"
#include "service/probe_stream.h"

namespace fogbank::service {

class ProbeServiceImplementation final : public v1::ProbeService::CallbackService {
 public:
  /// `control` answers the short calls, `pump` serves the Probe streams and nothing else.
  ProbeServiceImplementation(SceneRegistry& scenes, Scheduler& scheduler, TaskQueue& control,
                             StreamPump& pump)
      : services_{.scenes = scenes, .scheduler = scheduler, .control = control, .pump = pump} {}

  ProbeReactor* Probe(grpc::CallbackServerContext* context) override;
  grpc::ServerUnaryReactor* GetPlan(grpc::CallbackServerContext* context, const v1::GetPlanRequest* request,
                                    v1::GetPlanResponse* response) override;

  /// Ends all streams, those at whose client a write is waiting excepted, and takes no new ones.
  void shut_down();

 private:
  ProbeServices services_;
};

}  // namespace fogbank::service
