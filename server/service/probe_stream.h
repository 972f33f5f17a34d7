// One Probe stream: chunks of points in, results out.
#pragma once

#include <grpcpp/grpcpp.h>

#include <atomic>

#include "fogbank/v1/probe.pb.h"
#include "service/scene_registry.h"
#include "service/scheduling/scheduler.h"
#include "service/scheduling/task_queue.h"
#include "service/stream_pump.h"
#include "service/tenant_quota.h"
#include "service/trace_log.h"

namespace fogbank::service {

/// What the streams need of the server.
struct ProbeServices {
  SceneRegistry& scenes;
  Scheduler& scheduler;  ///< computes
  TaskQueue& control;    ///< asks for scenes
  StreamPump& pump;      ///< reads, checks and writes messages; of the probes alone
  TenantQuota& quota;
  int group = 0;               ///< in the scheduler
  TraceLog* traces = nullptr;  ///< null: nothing is traced
  std::atomic<bool> shutting_down = false;
};

using ProbeReactor = grpc::ServerBidiReactor<v1::ProbeRequest, v1::ProbeResponse>;

/// A reactor that deletes itself when the stream is done. `services` outlives it.
ProbeReactor* start_probe(grpc::CallbackServerContext& context, ProbeServices& services);

}  // namespace fogbank::service
