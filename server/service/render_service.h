// fogbank.v1.RenderService.
#pragma once

#include "fogbank/v1/render.grpc.pb.h"
#include "service/scheduling/task_queue.h"
#include "service/tenants.h"

namespace fogbank::service {

class RenderServiceImplementation final : public v1::RenderService::CallbackService {
 public:
  /// `control` answers the short calls, `downloads` reads images.
  RenderServiceImplementation(Tenants& tenants, TaskQueue& control, TaskQueue& downloads)
      : tenants_(tenants), control_(control), downloads_(downloads) {}

  grpc::ServerUnaryReactor* CreateJob(grpc::CallbackServerContext* context,
                                      const v1::CreateJobRequest* request,
                                      v1::CreateJobResponse* response) override;
  grpc::ServerUnaryReactor* GetJob(grpc::CallbackServerContext* context, const v1::GetJobRequest* request,
                                   v1::GetJobResponse* response) override;
  grpc::ServerUnaryReactor* ListJobs(grpc::CallbackServerContext* context, const v1::ListJobsRequest* request,
                                     v1::ListJobsResponse* response) override;
  grpc::ServerUnaryReactor* CancelJob(grpc::CallbackServerContext* context,
                                      const v1::CancelJobRequest* request,
                                      v1::CancelJobResponse* response) override;
  grpc::ServerUnaryReactor* PauseJob(grpc::CallbackServerContext* context, const v1::PauseJobRequest* request,
                                     v1::PauseJobResponse* response) override;
  grpc::ServerUnaryReactor* ResumeJob(grpc::CallbackServerContext* context,
                                      const v1::ResumeJobRequest* request,
                                      v1::ResumeJobResponse* response) override;
  grpc::ServerWriteReactor<v1::WatchJobResponse>* WatchJob(grpc::CallbackServerContext* context,
                                                           const v1::WatchJobRequest* request) override;
  grpc::ServerWriteReactor<v1::DownloadImageResponse>* DownloadImage(
      grpc::CallbackServerContext* context, const v1::DownloadImageRequest* request) override;

 private:
  Tenants& tenants_;
  TaskQueue& control_;
  TaskQueue& downloads_;
};

}  // namespace fogbank::service
