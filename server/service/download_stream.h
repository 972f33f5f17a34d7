// The stream of one download of a final image.
#pragma once

#include <grpcpp/grpcpp.h>

#include "fogbank/v1/render.pb.h"
#include "service/job_table.h"
#include "service/scheduling/task_queue.h"

namespace fogbank::service {

/// A reactor that deletes itself when the stream is done.
grpc::ServerWriteReactor<v1::DownloadImageResponse>* start_download(const v1::DownloadImageRequest& request,
                                                                    const JobTable& jobs, TaskQueue& queue);

}  // namespace fogbank::service
