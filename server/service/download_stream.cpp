#include "service/download_stream.h"

#include <algorithm>
#include <filesystem>
#include <string>

#include "core/files.h"
#include "service/answers.h"
#include "service/limits.h"
#include "service/names.h"

namespace fogbank::service {

namespace {

using grpc::StatusCode;

/// A chunk is read, written to the client, and only then the next one is read.
class DownloadReactor final : public grpc::ServerWriteReactor<v1::DownloadImageResponse> {
 public:
  DownloadReactor(const v1::DownloadImageRequest& request, const JobTable& jobs, TaskQueue& queue)
      : name_(request.name()), next_(request.offset()), jobs_(jobs), queue_(queue) {
    post([this] {
      open();
      send();
    });
  }

  void OnWriteDone(bool ok) override {
    if (!ok) {
      Finish(grpc::Status::CANCELLED);
    } else if (next_ == message_.size()) {
      Finish(grpc::Status::OK);
    } else {
      post([this] { send(); });
    }
  }

  void OnDone() override { delete this; }

 private:
  template <typename Work>
  void post(Work work) {
    const bool posted = queue_.post([this, work] {
      try {
        work();
      } catch (...) {
        Finish(status_of(std::current_exception()));
      }
    });
    if (!posted) Finish(shutting_down_status());
  }

  void open() {
    const std::shared_ptr<Job> job = jobs_.find(parse_job_name(name_));
    const v1::Job description = job->describe();
    const v1::JobState state = description.state();
    if (!has_ended(state)) {
      throw RpcError(StatusCode::FAILED_PRECONDITION, "JOB_NOT_FINISHED", name_ + " has not ended yet");
    }
    if (state != v1::JOB_STATE_SUCCEEDED) {
      throw RpcError(StatusCode::FAILED_PRECONDITION, "NO_IMAGE", name_ + " ended without an image");
    }
    message_.set_size(description.result().image_bytes());
    message_.set_sha256(description.result().image_sha256());
    if (next_ < 0 || next_ > message_.size()) {
      throw RpcError(StatusCode::OUT_OF_RANGE, "INVALID_OFFSET",
                     "offset must be 0 to " + std::to_string(message_.size()), {{"field", "offset"}});
    }
    path_ = job->image_path();
    std::error_code error;
    if (std::filesystem::file_size(path_, error) != static_cast<uintmax_t>(message_.size()) || error) {
      throw RpcError(StatusCode::DATA_LOSS, "IMAGE_DAMAGED",
                     "the stored image of " + name_ + " was changed or lost");
    }
  }

  void send() {
    const int64_t size = std::min(limits::max_download_chunk_bytes, message_.size() - next_);
    message_.set_offset(next_);
    message_.set_chunk(read_range(path_, next_, size));
    if (static_cast<int64_t>(message_.chunk().size()) != size) {
      throw RpcError(StatusCode::DATA_LOSS, "IMAGE_DAMAGED",
                     "the stored image of " + name_ + " was changed or lost");
    }
    next_ += size;
    StartWrite(&message_);
  }

  std::string name_;
  int64_t next_;
  const JobTable& jobs_;
  TaskQueue& queue_;
  std::filesystem::path path_;
  v1::DownloadImageResponse message_;
};

}  // namespace

grpc::ServerWriteReactor<v1::DownloadImageResponse>* start_download(const v1::DownloadImageRequest& request,
                                                                    const JobTable& jobs, TaskQueue& queue) {
  return new DownloadReactor(request, jobs, queue);
}

}  // namespace fogbank::service
