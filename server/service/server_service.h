// fogbank.v1.ServerService.
#pragma once

#include <filesystem>
#include <string>

#include "fogbank/v1/server.grpc.pb.h"
#include "service/sandbox/reader_host.h"
#include "service/scheduling/scheduler.h"
#include "service/tenants.h"

namespace fogbank::service {

class ServerServiceImplementation final : public v1::ServerService::CallbackService {
 public:
  /// `memory_bytes`: what scenes, caches and films may take together.
  ServerServiceImplementation(Tenants& tenants, bool scene_root, std::filesystem::path data,
                              int64_t memory_bytes, const Scheduler& scheduler, const ReaderHost& readers,
                              TaskQueue& control);

  grpc::ServerUnaryReactor* GetCapabilities(grpc::CallbackServerContext* context,
                                            const v1::GetCapabilitiesRequest* request,
                                            v1::GetCapabilitiesResponse* response) override;
  grpc::ServerUnaryReactor* GetServerStatus(grpc::CallbackServerContext* context,
                                            const v1::GetServerStatusRequest* request,
                                            v1::GetServerStatusResponse* response) override;

 private:
  Tenants& tenants_;
  const std::filesystem::path data_;
  const int64_t memory_bytes_;
  const Scheduler& scheduler_;
  const ReaderHost& readers_;
  TaskQueue& control_;
  const google::protobuf::Timestamp start_time_;
  const Clock::time_point start_ = Clock::now();
  v1::GetCapabilitiesResponse capabilities_;
};

}  // namespace fogbank::service
