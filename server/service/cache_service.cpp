#include "service/cache_service.h"

#include "service/cache_view_stream.h"

namespace fogbank::service {

grpc::ServerWriteReactor<v1::FillCacheResponse>* CacheServiceImplementation::FillCache(
    grpc::CallbackServerContext* context, const v1::FillCacheRequest* request) {
  return start_fill(*context, *request, fill_services_);
}

grpc::ServerWriteReactor<v1::ViewCacheResponse>* CacheServiceImplementation::ViewCache(
    grpc::CallbackServerContext*, const v1::ViewCacheRequest* request) {
  return start_view(*request, fill_services_.scenes, fill_services_.caches, files_);
}

void CacheServiceImplementation::shut_down() {
  fill_services_.shutting_down = true;
  fill_services_.pump.news();
}

}  // namespace fogbank::service
