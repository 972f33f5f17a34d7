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
  return start_fill(*context, *request, fill_services_);
}

grpc::ServerWriteReactor<v1::ViewCacheResponse>* CacheServiceImplementation::ViewCache(
    grpc::CallbackServerContext*, const v1::ViewCacheRequest* request) {
  return start_view(*request, fill_services_.scenes, fill_services_.caches, files_);
}

grpc::ServerUnaryReactor* CacheServiceImplementation::GetCache(grpc::CallbackServerContext* context,
                                                               const v1::GetCacheRequest* request,
                                                               v1::GetCacheResponse* response) {
  return answer(context, files_, [this, request, response] {
    *response->mutable_cache() = fill_services_.caches.describe(parse_cache_name(request->name()));
  });
}

grpc::ServerUnaryReactor* CacheServiceImplementation::ListCaches(grpc::CallbackServerContext* context,
                                                                 const v1::ListCachesRequest* request,
                                                                 v1::ListCachesResponse* response) {
  return answer(context, files_, [this, request, response] {
    *response = fill_services_.caches.list(request->page_size(), request->page_token());
  });
}

grpc::ServerUnaryReactor* CacheServiceImplementation::ImportCache(grpc::CallbackServerContext* context,
                                                                  const v1::ImportCacheRequest* request,
                                                                  v1::ImportCacheResponse* response) {
  return answer(context, files_, [this, request, response] {
    const std::string transport = request->cache().empty() ? "" : parse_cache_name(request->cache());
    const std::filesystem::path file = uploaded_file(request->sha256(), blobs_);
    with_file_errors([&] { *response = fill_services_.caches.import_from(file, transport); });
  });
}

grpc::ServerUnaryReactor* CacheServiceImplementation::VerifyCache(grpc::CallbackServerContext* context,
                                                                  const v1::VerifyCacheRequest* request,
                                                                  v1::VerifyCacheResponse* response) {
  return answer(context, files_, [this, request, response] {
    *response = fill_services_.caches.verify(parse_cache_name(request->name()));
  });
}

grpc::ServerUnaryReactor* CacheServiceImplementation::CollectCacheGarbage(
    grpc::CallbackServerContext* context, const v1::CollectCacheGarbageRequest* request,
    v1::CollectCacheGarbageResponse* response) {
  return answer(context, files_, [this, request, response] {
    *response = fill_services_.caches.collect_garbage(
        request->has_budget_bytes() ? std::optional<int64_t>(request->budget_bytes()) : std::nullopt);
  });
}

grpc::ServerUnaryReactor* CacheServiceImplementation::DeleteCache(grpc::CallbackServerContext* context,
                                                                  const v1::DeleteCacheRequest* request,
                                                                  v1::DeleteCacheResponse*) {
  return answer(context, files_,
                [this, request] { fill_services_.caches.remove(parse_cache_name(request->name())); });
}

grpc::ServerWriteReactor<v1::ExportCacheResponse>* CacheServiceImplementation::ExportCache(
    grpc::CallbackServerContext*, const v1::ExportCacheRequest* request) {
  return start_export(*request, fill_services_.caches, files_);
}

grpc::ServerWriteReactor<v1::MergeCachesResponse>* CacheServiceImplementation::MergeCaches(
    grpc::CallbackServerContext*, const v1::MergeCachesRequest* request) {
  return start_merge(*request, fill_services_.caches, blobs_, files_);
}

void CacheServiceImplementation::shut_down() {
  fill_services_.shutting_down = true;
  fill_services_.pump.news();
}

}  // namespace fogbank::service
