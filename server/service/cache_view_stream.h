// The stream of what a picture of a cache is drawn from.
#pragma once

#include <grpcpp/grpcpp.h>

#include "fogbank/v1/cache.pb.h"
#include "service/cache_registry.h"
#include "service/scene_registry.h"
#include "service/scheduling/task_queue.h"

namespace fogbank::service {

/// A reactor that deletes itself when the stream is done. `queue` does the work.
grpc::ServerWriteReactor<v1::ViewCacheResponse>* start_view(const v1::ViewCacheRequest& request,
                                                            SceneRegistry& scenes, CacheRegistry& caches,
                                                            TaskQueue& queue);

}  // namespace fogbank::service
