// fogbank.v1.CacheService.
#pragma once

#include "fogbank/v1/cache.grpc.pb.h"
#include "service/fill_stream.h"

namespace fogbank::service {

class CacheServiceImplementation final : public v1::CacheService::CallbackService {
 public:
  /// `control` answers the short calls, `files` what reads much, `pump` serves the FillCache streams and
  /// nothing else.
  CacheServiceImplementation(SceneRegistry& scenes, CacheRegistry& caches, Scheduler& scheduler,
                             TaskQueue& control, TaskQueue& files, StreamPump& pump)
      : fill_services_{.scenes = scenes,
                       .caches = caches,
                       .scheduler = scheduler,
                       .control = control,
                       .pump = pump},
        files_(files) {}

  grpc::ServerWriteReactor<v1::FillCacheResponse>* FillCache(grpc::CallbackServerContext* context,
                                                             const v1::FillCacheRequest* request) override;
  grpc::ServerWriteReactor<v1::ViewCacheResponse>* ViewCache(grpc::CallbackServerContext* context,
                                                             const v1::ViewCacheRequest* request) override;

  /// Ends all fills, those at whose client a write is waiting excepted, and takes no new ones.
  void shut_down();

 private:
  FillServices fill_services_;
  TaskQueue& files_;
};

}  // namespace fogbank::service
