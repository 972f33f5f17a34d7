// fogbank.v1.FlatlandService.
#pragma once

#include "fogbank/v1/flatland.grpc.pb.h"
#include "service/flatland_call.h"

namespace fogbank::service {

class FlatlandServiceImplementation final : public v1::FlatlandService::CallbackService {
 public:
  FlatlandServiceImplementation(TaskQueue& control, Scheduler& scheduler)
      : control_(control), scheduler_(scheduler) {}

  grpc::ServerUnaryReactor* ProbeFlatland(grpc::CallbackServerContext* /*context*/,
                                          const v1::ProbeFlatlandRequest* request,
                                          v1::ProbeFlatlandResponse* response) override {
    return start_flatland_call(*request, *response, control_, scheduler_);
  }

  grpc::ServerUnaryReactor* FillFlatlandCache(grpc::CallbackServerContext* /*context*/,
                                              const v1::FillFlatlandCacheRequest* request,
                                              v1::FillFlatlandCacheResponse* response) override {
    return start_flatland_call(*request, *response, control_, scheduler_);
  }

 private:
  TaskQueue& control_;
  Scheduler& scheduler_;
};

}  // namespace fogbank::service
