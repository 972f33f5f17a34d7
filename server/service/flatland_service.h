// fogbank.v1.FlatlandService.
#pragma once

#include "fogbank/v1/flatland.grpc.pb.h"
#include "service/flatland_call.h"
#include "service/tenants.h"

namespace fogbank::service {

class FlatlandServiceImplementation final : public v1::FlatlandService::CallbackService {
 public:
  FlatlandServiceImplementation(Tenants& tenants, TaskQueue& control, Scheduler& scheduler)
      : tenants_(tenants), control_(control), scheduler_(scheduler) {}

  grpc::ServerUnaryReactor* ProbeFlatland(grpc::CallbackServerContext* context,
                                          const v1::ProbeFlatlandRequest* request,
                                          v1::ProbeFlatlandResponse* response) override {
    return start_in_tenant<grpc::ServerUnaryReactor>(
        tenants_, *context, "FlatlandService.ProbeFlatland", [&](Tenant& tenant) {
          tenant.quota.require_cpu();
          return start_flatland_call(*request, *response, control_, scheduler_, tenant.number);
        });
  }

  grpc::ServerUnaryReactor* FillFlatlandCache(grpc::CallbackServerContext* context,
                                              const v1::FillFlatlandCacheRequest* request,
                                              v1::FillFlatlandCacheResponse* response) override {
    return start_in_tenant<grpc::ServerUnaryReactor>(
        tenants_, *context, "FlatlandService.FillFlatlandCache", [&](Tenant& tenant) {
          tenant.quota.require_cpu();
          return start_flatland_call(*request, *response, control_, scheduler_, tenant.number);
        });
  }

 private:
  Tenants& tenants_;
  TaskQueue& control_;
  Scheduler& scheduler_;
};

}  // namespace fogbank::service
