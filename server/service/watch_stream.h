// The stream of one watcher of a job.
#pragma once

#include <grpcpp/grpcpp.h>

#include "fogbank/v1/render.pb.h"
#include "service/job_table.h"
#include "service/stream_pump.h"
#include "service/tenant_quota.h"

namespace fogbank::service {

/// A reactor that deletes itself when the stream is done.
grpc::ServerWriteReactor<v1::WatchJobResponse>* start_watch(grpc::CallbackServerContext& context,
                                                            const v1::WatchJobRequest& request,
                                                            const JobTable& jobs, const TenantQuota& quota,
                                                            StreamPump& pump);

}  // namespace fogbank::service
