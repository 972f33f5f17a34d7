// fogbank.v1.SceneService.
#pragma once

#include "fogbank/v1/scene.grpc.pb.h"
#include "service/scheduling/task_queue.h"
#include "service/tenants.h"

namespace fogbank::service {

class SceneServiceImplementation final : public v1::SceneService::CallbackService {
 public:
  /// `control` answers the short calls, `uploads` writes blobs.
  SceneServiceImplementation(Tenants& tenants, TaskQueue& control, TaskQueue& uploads)
      : tenants_(tenants), control_(control), uploads_(uploads) {}

  grpc::ServerUnaryReactor* PrepareScene(grpc::CallbackServerContext* context,
                                         const v1::PrepareSceneRequest* request,
                                         v1::PrepareSceneResponse* response) override;
  grpc::ServerUnaryReactor* QueryBlob(grpc::CallbackServerContext* context,
                                      const v1::QueryBlobRequest* request,
                                      v1::QueryBlobResponse* response) override;
  grpc::ServerReadReactor<v1::UploadBlobRequest>* UploadBlob(grpc::CallbackServerContext* context,
                                                             v1::UploadBlobResponse* response) override;
  grpc::ServerUnaryReactor* CreateScene(grpc::CallbackServerContext* context,
                                        const v1::CreateSceneRequest* request,
                                        v1::CreateSceneResponse* response) override;
  grpc::ServerUnaryReactor* GetScene(grpc::CallbackServerContext* context, const v1::GetSceneRequest* request,
                                     v1::GetSceneResponse* response) override;
  grpc::ServerUnaryReactor* ListScenes(grpc::CallbackServerContext* context,
                                       const v1::ListScenesRequest* request,
                                       v1::ListScenesResponse* response) override;
  grpc::ServerUnaryReactor* DeleteScene(grpc::CallbackServerContext* context,
                                        const v1::DeleteSceneRequest* request,
                                        v1::DeleteSceneResponse* response) override;

 private:
  Tenants& tenants_;
  TaskQueue& control_;
  TaskQueue& uploads_;
};

}  // namespace fogbank::service
