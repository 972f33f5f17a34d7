#include "service/complete_stream.h"

#include <memory>
#include <string>
#include <utility>

#include "service/answers.h"
#include "service/limits.h"
#include "service/names.h"

namespace fogbank::service {

namespace {

RpcError invalid_result(const std::string& message) {
  return {grpc::StatusCode::INVALID_ARGUMENT, "INVALID_RESULT", message};
}

/// A message is read, handed to the queue, taken, and only then the next one is read.
class CompleteStream final : public grpc::ServerReadReactor<v1::CompleteTasksRequest> {
 public:
  CompleteStream(v1::CompleteTasksResponse& response, JobTable& jobs, TaskQueue& queue)
      : response_(response), jobs_(jobs), queue_(queue) {
    StartRead(&message_);
  }

  void OnReadDone(bool ok) override {
    const bool posted = queue_.post([this, ok] { ok ? handle_message() : handle_end(); });
    if (!posted) Finish(shutting_down_status());
  }

  void OnDone() override { delete this; }

 private:
  void handle_message() {
    try {
      if (!job_) {
        if (message_.job().empty()) throw invalid_result("the first message must name the job");
        job_ = jobs_.find(parse_job_name(message_.job()));
        log_ = message_.log();
      }
      if (message_.has_part()) take(message_.part());
    } catch (...) {
      Finish(status_of(std::current_exception()));
      return;
    }
    StartRead(&message_);
  }

  void take(const v1::TaskResultPart& part) {
    if (part.data().size() > static_cast<size_t>(limits::max_result_part_bytes))
      throw invalid_result("a part is above max_result_part_bytes");
    const bool goes_on = in_part_ && part.stage() == stage_ && part.index() == index_;
    if (in_part_ ? !goes_on : part.offset() != 0)
      throw invalid_result("the parts of a result must follow each other, from its beginning");
    if (part.offset() != static_cast<int64_t>(bytes_.size()))
      throw invalid_result("a part of a result is missing");
    if (bytes_.size() + part.data().size() > static_cast<size_t>(limits::max_result_bytes))
      throw invalid_result("a result is above max_result_bytes");
    bytes_ += part.data();
    stage_ = part.stage();
    index_ = part.index();
    in_part_ = !part.last();
    if (part.last()) job_->complete(log_, part, std::exchange(bytes_, {}), response_);
  }

  void handle_end() {
    try {
      if (!job_) throw invalid_result("no message named the job");
      if (in_part_) throw invalid_result("the last part of a result is missing");
    } catch (...) {
      Finish(status_of(std::current_exception()));
      return;
    }
    Finish(grpc::Status::OK);
  }

  v1::CompleteTasksResponse& response_;
  JobTable& jobs_;
  TaskQueue& queue_;
  v1::CompleteTasksRequest message_;
  std::shared_ptr<Job> job_;
  std::string log_;
  bool in_part_ = false;  ///< more parts of this result are to come:
  uint32_t stage_ = 0;
  uint32_t index_ = 0;
  std::string bytes_;
};

}  // namespace

grpc::ServerReadReactor<v1::CompleteTasksRequest>* start_completion(v1::CompleteTasksResponse& response,
                                                                    JobTable& jobs, TaskQueue& queue) {
  return new CompleteStream(response, jobs, queue);  // deletes itself when done
}

}  // namespace fogbank::service
