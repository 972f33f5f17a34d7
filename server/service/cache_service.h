// fogbank.v1.CacheService.
#pragma once

#include "fogbank/v1/cache.grpc.pb.h"
#include "service/scheduling/task_queue.h"
#include "service/tenants.h"

namespace fogbank::service {

class CacheServiceImplementation final : public v1::CacheService::CallbackService {
 public:
  /// `files` does what may take long.
  CacheServiceImplementation(Tenants& tenants, TaskQueue& files) : tenants_(tenants), files_(files) {}

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

 private:
  Tenants& tenants_;
  TaskQueue& files_;
};

}  // namespace fogbank::service
