// Streams of caches as files.
#pragma once

#include <grpcpp/grpcpp.h>

#include "fogbank/v1/cache.pb.h"
#include "service/blob_store.h"
#include "service/cache_registry.h"
#include "service/scheduling/task_queue.h"

namespace fogbank::service {

/// Reactors that delete themselves when the stream is done; `queue` does the work.
grpc::ServerWriteReactor<v1::ExportCacheResponse>* start_export(const v1::ExportCacheRequest& request,
                                                                CacheRegistry& caches, TaskQueue& queue);
grpc::ServerWriteReactor<v1::MergeCachesResponse>* start_merge(const v1::MergeCachesRequest& request,
                                                               CacheRegistry& caches, BlobStore& blobs,
                                                               TaskQueue& queue);

/// An uploaded file. Throws RpcError INVALID_SHA256, BLOBS_MISSING.
std::filesystem::path uploaded_file(const std::string& sha256, BlobStore& blobs);

/// Runs `work`; what is wrong with an exported file becomes RpcError INVALID_CACHE_FILE or
/// CACHE_OF_ANOTHER_SCENE.
void with_file_errors(const std::function<void()>& work);

}  // namespace fogbank::service
