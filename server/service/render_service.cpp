#include "service/render_service.h"

#include "service/answers.h"
#include "service/download_stream.h"
#include "service/names.h"
#include "service/watch_stream.h"

namespace fogbank::service {

grpc::ServerUnaryReactor* RenderServiceImplementation::CreateJob(grpc::CallbackServerContext* context,
                                                                 const v1::CreateJobRequest* request,
                                                                 v1::CreateJobResponse* response) {
  return answer_later(context, control_, [this, request, response](grpc::ServerUnaryReactor* reactor) {
    jobs_.create(*request, [response, reactor](const std::shared_ptr<Job>& job, std::exception_ptr error) {
      if (error) {
        reactor->Finish(status_of(error));
        return;
      }
      *response->mutable_job() = job->describe();
      reactor->Finish(grpc::Status::OK);
    });
  });
}

grpc::ServerUnaryReactor* RenderServiceImplementation::GetJob(grpc::CallbackServerContext* context,
                                                              const v1::GetJobRequest* request,
                                                              v1::GetJobResponse* response) {
  return answer(context, control_, [this, request, response] {
    *response->mutable_job() = jobs_.find(parse_job_name(request->name()))->describe();
  });
}

grpc::ServerUnaryReactor* RenderServiceImplementation::ListJobs(grpc::CallbackServerContext* context,
                                                                const v1::ListJobsRequest* request,
                                                                v1::ListJobsResponse* response) {
  return answer(context, control_, [this, request, response] { *response = jobs_.list(*request); });
}

grpc::ServerUnaryReactor* RenderServiceImplementation::CancelJob(grpc::CallbackServerContext* context,
                                                                 const v1::CancelJobRequest* request,
                                                                 v1::CancelJobResponse* response) {
  return answer(context, control_, [this, request, response] {
    const std::shared_ptr<Job> job = jobs_.find(parse_job_name(request->name()));
    job->cancel({grpc::StatusCode::CANCELLED, "JOB_CANCELLED", "the job was cancelled"});
    *response->mutable_job() = job->describe();
  });
}

grpc::ServerUnaryReactor* RenderServiceImplementation::PauseJob(grpc::CallbackServerContext* context,
                                                                const v1::PauseJobRequest* request,
                                                                v1::PauseJobResponse* response) {
  return answer(context, control_, [this, request, response] {
    const std::shared_ptr<Job> job = jobs_.find(parse_job_name(request->name()));
    job->pause();
    *response->mutable_job() = job->describe();
  });
}

grpc::ServerUnaryReactor* RenderServiceImplementation::ResumeJob(grpc::CallbackServerContext* context,
                                                                 const v1::ResumeJobRequest* request,
                                                                 v1::ResumeJobResponse* response) {
  return answer(context, control_, [this, request, response] {
    const std::shared_ptr<Job> job = jobs_.find(parse_job_name(request->name()));
    job->unpause();
    jobs_.wake();
    *response->mutable_job() = job->describe();
  });
}

grpc::ServerWriteReactor<v1::WatchJobResponse>* RenderServiceImplementation::WatchJob(
    grpc::CallbackServerContext* context, const v1::WatchJobRequest* request) {
  return start_watch(*context, *request, jobs_, pump_);
}

grpc::ServerWriteReactor<v1::DownloadImageResponse>* RenderServiceImplementation::DownloadImage(
    grpc::CallbackServerContext*, const v1::DownloadImageRequest* request) {
  return start_download(*request, jobs_, downloads_);
}

}  // namespace fogbank::service
