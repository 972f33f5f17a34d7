#include "service/cache_service.h"

#include <optional>
#include <string>

#include "service/answers.h"
#include "service/cache_transfer.h"
#include "service/cache_view_stream.h"
#include "service/names.h"

namespace fogbank::service {

grpc::ServerWriteReactor<v1::FillCacheResponse>* CacheServiceImplementation::FillCache(
    grpc::CallbackServerContext* context, const v1::FillCacheRequest* request) {
  using Reactor = grpc::ServerWriteReactor<v1::FillCacheResponse>;
  return start_in_tenant<Reactor>(tenants_, *context, "CacheService.FillCache", [&](Tenant& tenant) {
    return start_fill(*context, *request, tenant.fills);
  });
}

grpc::ServerWriteReactor<v1::ViewCacheResponse>* CacheServiceImplementation::ViewCache(
    grpc::CallbackServerContext* context, const v1::ViewCacheRequest* request) {
  using Reactor = grpc::ServerWriteReactor<v1::ViewCacheResponse>;
  return start_in_tenant<Reactor>(tenants_, *context, "CacheService.ViewCache", [&](Tenant& tenant) {
    return start_view(*request, tenant.scenes, tenant.caches, files_);
  });
}

grpc::ServerUnaryReactor* CacheServiceImplementation::GetCache(grpc::CallbackServerContext* context,
                                                               const v1::GetCacheRequest* request,
                                                               v1::GetCacheResponse* response) {
  return answer(context, files_, [this, context, request, response] {
    Tenant& tenant = tenants_.enter(*context, "CacheService.GetCache");
    *response->mutable_cache() = tenant.caches.describe(parse_cache_name(request->name()));
  });
}

grpc::ServerUnaryReactor* CacheServiceImplementation::ListCaches(grpc::CallbackServerContext* context,
                                                                 const v1::ListCachesRequest* request,
                                                                 v1::ListCachesResponse* response) {
  return answer(context, files_, [this, context, request, response] {
    Tenant& tenant = tenants_.enter(*context, "CacheService.ListCaches");
    *response = tenant.caches.list(request->page_size(), request->page_token());
  });
}

grpc::ServerUnaryReactor* CacheServiceImplementation::ImportCache(grpc::CallbackServerContext* context,
                                                                  const v1::ImportCacheRequest* request,
                                                                  v1::ImportCacheResponse* response) {
  return answer(context, files_, [this, context, request, response] {
    Tenant& tenant = tenants_.enter(*context, "CacheService.ImportCache");
    const std::string transport = request->cache().empty() ? "" : parse_cache_name(request->cache());
    const std::filesystem::path file = uploaded_file(request->sha256(), tenant.blobs);
    tenant.quota.require_cache(static_cast<int64_t>(std::filesystem::file_size(file)));
    with_file_errors([&] { *response = tenant.caches.import_from(file, transport); });
  });
}

grpc::ServerUnaryReactor* CacheServiceImplementation::VerifyCache(grpc::CallbackServerContext* context,
                                                                  const v1::VerifyCacheRequest* request,
                                                                  v1::VerifyCacheResponse* response) {
  return answer(context, files_, [this, context, request, response] {
    Tenant& tenant = tenants_.enter(*context, "CacheService.VerifyCache");
    *response = tenant.caches.verify(parse_cache_name(request->name()));
  });
}

grpc::ServerUnaryReactor* CacheServiceImplementation::CollectCacheGarbage(
    grpc::CallbackServerContext* context, const v1::CollectCacheGarbageRequest* request,
    v1::CollectCacheGarbageResponse* response) {
  return answer(context, files_, [this, context, request, response] {
    Tenant& tenant = tenants_.enter(*context, "CacheService.CollectCacheGarbage");
    *response = tenant.caches.collect_garbage(
        request->has_budget_bytes() ? std::optional<int64_t>(request->budget_bytes()) : std::nullopt);
  });
}

grpc::ServerUnaryReactor* CacheServiceImplementation::DeleteCache(grpc::CallbackServerContext* context,
                                                                  const v1::DeleteCacheRequest* request,
                                                                  v1::DeleteCacheResponse*) {
  return answer(context, files_, [this, context, request] {
    CacheRegistry& caches = tenants_.enter(*context, "CacheService.DeleteCache").caches;
    caches.remove(parse_cache_name(request->name()));
  });
}

grpc::ServerWriteReactor<v1::ExportCacheResponse>* CacheServiceImplementation::ExportCache(
    grpc::CallbackServerContext* context, const v1::ExportCacheRequest* request) {
  using Reactor = grpc::ServerWriteReactor<v1::ExportCacheResponse>;
  return start_in_tenant<Reactor>(tenants_, *context, "CacheService.ExportCache", [&](Tenant& tenant) {
    return start_export(*request, tenant.caches, files_);
  });
}

grpc::ServerWriteReactor<v1::MergeCachesResponse>* CacheServiceImplementation::MergeCaches(
    grpc::CallbackServerContext* context, const v1::MergeCachesRequest* request) {
  using Reactor = grpc::ServerWriteReactor<v1::MergeCachesResponse>;
  return start_in_tenant<Reactor>(tenants_, *context, "CacheService.MergeCaches", [&](Tenant& tenant) {
    return start_merge(*request, tenant.caches, tenant.blobs, files_);
  });
}

}  // namespace fogbank::service
