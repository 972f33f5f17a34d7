#include "service/render_service.h"

#include "service/answers.h"
#include "service/download_stream.h"
#include "service/names.h"
#include "service/watch_stream.h"
#include "service/work_trace.h"

namespace fogbank::service {

grpc::ServerUnaryReactor* RenderServiceImplementation::CreateJob(grpc::CallbackServerContext* context,
                                                                 const v1::CreateJobRequest* request,
                                                                 v1::CreateJobResponse* response) {
  return answer_later(
      context, control_, [this, context, request, response](grpc::ServerUnaryReactor* reactor) {
        tenants_.enter(*context, "RenderService.CreateJob")
            .jobs.create(*request, client_trace(*context),
                         [response, reactor](const std::shared_ptr<Job>& job, std::exception_ptr error) {
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
  return answer(context, control_, [this, context, request, response] {
    const JobTable& jobs = tenants_.enter(*context, "RenderService.GetJob").jobs;
    *response->mutable_job() = jobs.find(parse_job_name(request->name()))->describe();
  });
}

grpc::ServerUnaryReactor* RenderServiceImplementation::ListJobs(grpc::CallbackServerContext* context,
                                                                const v1::ListJobsRequest* request,
                                                                v1::ListJobsResponse* response) {
  return answer(context, control_, [this, context, request, response] {
    *response = tenants_.enter(*context, "RenderService.ListJobs").jobs.list(*request);
  });
}

grpc::ServerUnaryReactor* RenderServiceImplementation::CancelJob(grpc::CallbackServerContext* context,
                                                                 const v1::CancelJobRequest* request,
                                                                 v1::CancelJobResponse* response) {
  return answer(context, control_, [this, context, request, response] {
    const JobTable& jobs = tenants_.enter(*context, "RenderService.CancelJob").jobs;
    const std::shared_ptr<Job> job = jobs.find(parse_job_name(request->name()));
    job->cancel({grpc::StatusCode::CANCELLED, "JOB_CANCELLED", "the job was cancelled"});
    *response->mutable_job() = job->describe();
  });
}

grpc::ServerUnaryReactor* RenderServiceImplementation::PauseJob(grpc::CallbackServerContext* context,
                                                                const v1::PauseJobRequest* request,
                                                                v1::PauseJobResponse* response) {
  return answer(context, control_, [this, context, request, response] {
    JobTable& jobs = tenants_.enter(*context, "RenderService.PauseJob").jobs;
    const std::shared_ptr<Job> job = jobs.find(parse_job_name(request->name()));
    jobs.pause(job);
    *response->mutable_job() = job->describe();
  });
}

grpc::ServerUnaryReactor* RenderServiceImplementation::ResumeJob(grpc::CallbackServerContext* context,
                                                                 const v1::ResumeJobRequest* request,
                                                                 v1::ResumeJobResponse* response) {
  return answer(context, control_, [this, context, request, response] {
    JobTable& jobs = tenants_.enter(*context, "RenderService.ResumeJob").jobs;
    const std::shared_ptr<Job> job = jobs.find(parse_job_name(request->name()));
    jobs.unpause(job);
    *response->mutable_job() = job->describe();
  });
}

grpc::ServerWriteReactor<v1::WatchJobResponse>* RenderServiceImplementation::WatchJob(
    grpc::CallbackServerContext* context, const v1::WatchJobRequest* request) {
  using Reactor = grpc::ServerWriteReactor<v1::WatchJobResponse>;
  return start_in_tenant<Reactor>(tenants_, *context, "RenderService.WatchJob", [&](Tenant& tenant) {
    return start_watch(*context, *request, tenant.jobs, tenant.quota, tenant.pump);
  });
}

grpc::ServerWriteReactor<v1::DownloadImageResponse>* RenderServiceImplementation::DownloadImage(
    grpc::CallbackServerContext* context, const v1::DownloadImageRequest* request) {
  using Reactor = grpc::ServerWriteReactor<v1::DownloadImageResponse>;
  return start_in_tenant<Reactor>(tenants_, *context, "RenderService.DownloadImage", [&](Tenant& tenant) {
    return start_download(*request, tenant.jobs, downloads_);
  });
}

}  // namespace fogbank::service
