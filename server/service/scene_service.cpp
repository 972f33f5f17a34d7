#include "service/scene_service.h"

#include <memory>

#include "service/answers.h"
#include "service/names.h"

namespace fogbank::service {

namespace {

/// One upload: a message is read, handed to the queue, written, and only then the next one is read, so that
/// the disk slows the client down.
class UploadReactor final : public grpc::ServerReadReactor<v1::UploadBlobRequest> {
 public:
  UploadReactor(BlobStore& blobs, TaskQueue& queue, v1::UploadBlobResponse& response)
      : blobs_(blobs), queue_(queue), response_(response) {
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
      if (message_.has_header() == (upload_ != nullptr)) {
        throw RpcError(grpc::StatusCode::INVALID_ARGUMENT, "INVALID_UPLOAD",
                       upload_ ? "a second header" : "the first message must be the header");
      }
      if (upload_) {
        upload_->append(message_.chunk());
      } else {
        const v1::UploadBlobHeader& header = message_.header();
        upload_ = blobs_.begin(header.sha256(), header.size(), header.offset());
        if (upload_->already_complete()) {
          handle_end();
          return;
        }
      }
    } catch (...) {
      finish(status_of(std::current_exception()));
      return;
    }
    StartRead(&message_);
  }

  void handle_end() {
    try {
      if (!upload_)
        throw RpcError(grpc::StatusCode::INVALID_ARGUMENT, "INVALID_UPLOAD", "there was no header");
      upload_->finish();
      response_.set_committed_size(upload_->size());
    } catch (...) {
      finish(status_of(std::current_exception()));
      return;
    }
    finish(grpc::Status::OK);
  }

  void finish(const grpc::Status& status) {
    upload_.reset();  // another stream may go on with this blob as soon as the client hears of the end
    Finish(status);
  }

  BlobStore& blobs_;
  TaskQueue& queue_;
  v1::UploadBlobResponse& response_;
  v1::UploadBlobRequest message_;
  std::unique_ptr<BlobStore::Upload> upload_;
};

}  // namespace

grpc::ServerUnaryReactor* SceneServiceImplementation::PrepareScene(grpc::CallbackServerContext* context,
                                                                   const v1::PrepareSceneRequest* request,
                                                                   v1::PrepareSceneResponse* response) {
  return answer(context, control_, [this, context, request, response] {
    const Tenant& tenant = tenants_.enter(*context, "SceneService.PrepareScene");
    *response = tenant.scenes.prepare(request->manifest());
  });
}

grpc::ServerUnaryReactor* SceneServiceImplementation::QueryBlob(grpc::CallbackServerContext* context,
                                                                const v1::QueryBlobRequest* request,
                                                                v1::QueryBlobResponse* response) {
  return answer(context, control_, [this, context, request, response] {
    BlobStore& blobs = tenants_.enter(*context, "SceneService.QueryBlob").blobs;
    const BlobStore::Presence presence = blobs.query(request->sha256());
    response->set_committed_size(presence.committed_size);
    response->set_complete(presence.complete);
  });
}

grpc::ServerReadReactor<v1::UploadBlobRequest>* SceneServiceImplementation::UploadBlob(
    grpc::CallbackServerContext* context, v1::UploadBlobResponse* response) {
  using Reactor = grpc::ServerReadReactor<v1::UploadBlobRequest>;
  return start_in_tenant<Reactor>(tenants_, *context, "SceneService.UploadBlob", [&](Tenant& tenant) {
    return new UploadReactor(tenant.blobs, uploads_, *response);  // deletes itself when done
  });
}

grpc::ServerUnaryReactor* SceneServiceImplementation::CreateScene(grpc::CallbackServerContext* context,
                                                                  const v1::CreateSceneRequest* request,
                                                                  v1::CreateSceneResponse* response) {
  return answer_later(
      context, control_, [this, context, request, response](grpc::ServerUnaryReactor* reactor) {
        tenants_.enter(*context, "SceneService.CreateScene")
            .scenes.create(*request, [response, reactor](const v1::Scene& scene, bool already_loaded,
                                                         std::exception_ptr error) {
              if (error) {
                reactor->Finish(status_of(error));
                return;
              }
              *response->mutable_scene() = scene;
              response->set_already_loaded(already_loaded);
              reactor->Finish(grpc::Status::OK);
            });
      });
}

grpc::ServerUnaryReactor* SceneServiceImplementation::GetScene(grpc::CallbackServerContext* context,
                                                               const v1::GetSceneRequest* request,
                                                               v1::GetSceneResponse* response) {
  return answer(context, control_, [this, context, request, response] {
    const SceneRegistry& scenes = tenants_.enter(*context, "SceneService.GetScene").scenes;
    *response->mutable_scene() = scenes.get(parse_scene_name(request->name()));
  });
}

grpc::ServerUnaryReactor* SceneServiceImplementation::ListScenes(grpc::CallbackServerContext* context,
                                                                 const v1::ListScenesRequest* request,
                                                                 v1::ListScenesResponse* response) {
  return answer(context, control_, [this, context, request, response] {
    const SceneRegistry& scenes = tenants_.enter(*context, "SceneService.ListScenes").scenes;
    *response = scenes.list(request->page_size(), request->page_token());
  });
}

grpc::ServerUnaryReactor* SceneServiceImplementation::DeleteScene(grpc::CallbackServerContext* context,
                                                                  const v1::DeleteSceneRequest* request,
                                                                  v1::DeleteSceneResponse*) {
  return answer(context, control_, [this, context, request] {
    SceneRegistry& scenes = tenants_.enter(*context, "SceneService.DeleteScene").scenes;
    scenes.remove(parse_scene_name(request->name()));
  });
}

}  // namespace fogbank::service
