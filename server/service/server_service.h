// fogbank.v1.ServerService.
#pragma once

#include <string>

#include "fogbank/v1/server.grpc.pb.h"
#include "service/job_table.h"
#include "service/scene_registry.h"
#include "service/scheduling/scheduler.h"
#include "service/stream_pump.h"

namespace fogbank::service {

class ServerServiceImplementation final : public v1::ServerService::CallbackService {
 public:
  ServerServiceImplementation(const SceneRegistry& scenes, const JobTable& jobs, const CacheRegistry& caches,
                              const Scheduler& scheduler, const StreamPump& watchers,
                              const StreamPump& probes, const StreamPump& fills, TaskQueue& control);

  grpc::ServerUnaryReactor* GetCapabilities(grpc::CallbackServerContext* context,
                                            const v1::GetCapabilitiesRequest* request,
                                            v1::GetCapabilitiesResponse* response) override;
  grpc::ServerUnaryReactor* GetServerStatus(grpc::CallbackServerContext* context,
                                            const v1::GetServerStatusRequest* request,
                                            v1::GetServerStatusResponse* response) override;

 private:
  const SceneRegistry& scenes_;
  const JobTable& jobs_;
  const CacheRegistry& caches_;
  const Scheduler& scheduler_;
  const StreamPump& watchers_;
  const StreamPump& probes_;
  const StreamPump& fills_;
  TaskQueue& control_;
  const google::protobuf::Timestamp start_time_;
  const Clock::time_point start_ = Clock::now();
  v1::GetCapabilitiesResponse capabilities_;
};

}  // namespace fogbank::service
