// fogbank.v1.CacheService.
#pragma once

#include "fogbank/v1/cache.grpc.pb.h"
#include "service/fill_stream.h"

namespace fogbank::service {

class CacheServiceImplementation final : public v1::CacheService::CallbackService {
 public:
  /// `control` answers the short calls, `files` what reads much, `pump` serves the FillCache streams and
  /// nothing else.
  CacheServiceImplementation(SceneRegistry& scenes, CacheRegistry& caches, BlobStore& blobs,
                             Scheduler& scheduler, TaskQueue& control, TaskQueue& files, StreamPump& pump)
      : fill_services_{.scenes = scenes,
                       .caches = caches,
                       .scheduler = scheduler,
                       .control = control,
                       .pump = pump},
        blobs_(blobs),
        files_(files) {}

  grpc::ServerUnaryReactor* GetCache(grpc::CallbackServerContext* context, const v1::GetCacheRequest* request,
                                     v1::GetCacheResponse* response) override;
  grpc::ServerUnaryReactor* ListCaches(grpc::CallbackServerContext* context,
                                       const v1::ListCachesRequest* request,
                                       v1::ListCachesResponse* response) override;
  grpc::ServerUnaryReactor* ImportCache(grpc::CallbackServerContext* context,
                                        const v1::ImportCacheRequest* request,
                                        v1::ImportCacheResponse* response) override;
  grpc::ServerUnaryReactor* VerifyCache(grpc::CallbackServerContext* context,
                                        const v1::VerifyCacheRequest* request,
                                        v1::VerifyCacheResponse* response) override;
  grpc::ServerUnaryReactor* CollectCacheGarbage(grpc::CallbackServerContext* context,
                                                const v1::CollectCacheGarbageRequest* request,
                                                v1::CollectCacheGarbageResponse* response) override;
  grpc::ServerUnaryReactor* DeleteCache(grpc::CallbackServerContext* context,
                                        const v1::DeleteCacheRequest* request,
                                        v1::DeleteCacheResponse* response) override;
  grpc::ServerWriteReactor<v1::ExportCacheResponse>* ExportCache(
      grpc::CallbackServerContext* context, const v1::ExportCacheRequest* request) override;
  grpc::ServerWriteReactor<v1::MergeCachesResponse>* MergeCaches(
      grpc::CallbackServerContext* context, const v1::MergeCachesRequest* request) override;

  grpc::ServerWriteReactor<v1::FillCacheResponse>* FillCache(grpc::CallbackServerContext* context,
                                                             const v1::FillCacheRequest* request) override;
  grpc::ServerWriteReactor<v1::ViewCacheResponse>* ViewCache(grpc::CallbackServerContext* context,
                                                             const v1::ViewCacheRequest* request) override;

  /// Ends all fills, those at whose client a write is waiting excepted, and takes no new ones.
  void shut_down();

 private:
  FillServices fill_services_;
  BlobStore& blobs_;
  TaskQueue& files_;
};

}  // namespace fogbank::service
