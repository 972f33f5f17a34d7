// The stream of one fill of a cache.
#pragma once

#include <grpcpp/grpcpp.h>

#include <atomic>

#include "fogbank/v1/cache.pb.h"
#include "service/cache_registry.h"
#include "service/scene_registry.h"
#include "service/scheduling/scheduler.h"
#include "service/stream_pump.h"
#include "service/tenant_quota.h"
#include "service/trace_log.h"

namespace fogbank::service {

/// What fills need of the server.
struct FillServices {
  SceneRegistry& scenes;
  CacheRegistry& caches;
  Scheduler& scheduler;
  TaskQueue& control;
  StreamPump& pump;  ///< serves FillCache streams and nothing else
  TenantQuota& quota;
  int group = 0;               ///< in the scheduler
  TraceLog* traces = nullptr;  ///< null: nothing is traced
  std::atomic<bool> shutting_down = false;
};

/// A reactor that deletes itself when the stream is done.
grpc::ServerWriteReactor<v1::FillCacheResponse>* start_fill(grpc::CallbackServerContext& context,
                                                            const v1::FillCacheRequest& request,
                                                            FillServices& services);

}  // namespace fogbank::service
