#include "service/download_stream.h"

#include <string>

#include "service/file_stream.h"
#include "service/names.h"

namespace fogbank::service {

namespace {

using grpc::StatusCode;

StreamedFile image_of(const std::string& name, const JobTable& jobs) {
  const std::shared_ptr<Job> job = jobs.find(parse_job_name(name));
  const v1::Job description = job->describe();
  const v1::JobState state = description.state();
  if (!has_ended(state)) {
    throw RpcError(StatusCode::FAILED_PRECONDITION, "JOB_NOT_FINISHED", name + " has not ended yet");
  }
  if (state != v1::JOB_STATE_SUCCEEDED || description.fill_only()) {
    throw RpcError(StatusCode::FAILED_PRECONDITION, "NO_IMAGE", name + " ended without an image");
  }
  return {.path = job->image_path(),
          .size = description.result().image_bytes(),
          .sha256 = description.result().image_sha256(),
          .damage = "IMAGE_DAMAGED",
          .temporary = {}};
}

void set_chunk(v1::DownloadImageResponse& response, const StreamedFile& file, int64_t offset,
               std::string bytes) {
  response.set_size(file.size);
  response.set_sha256(file.sha256);
  response.set_offset(offset);
  response.set_chunk(std::move(bytes));
}

}  // namespace

grpc::ServerWriteReactor<v1::DownloadImageResponse>* start_download(const v1::DownloadImageRequest& request,
                                                                    const JobTable& jobs, TaskQueue& queue) {
  return new FileStream<v1::DownloadImageResponse>(
      queue, request.offset(), [name = request.name(), &jobs] { return image_of(name, jobs); }, set_chunk);
}

}  // namespace fogbank::service
