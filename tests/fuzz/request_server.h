// The server as the target `request` has it: whole, in this process, called over a unix socket.
#pragma once

#include <grpcpp/generic/generic_stub.h>
#include <grpcpp/grpcpp.h>

#include <filesystem>
#include <memory>
#include <string>

#include "fogbank/v1/render.pb.h"
#include "request_call.h"
#include "service/server.h"

namespace fogbank::fuzz {

/// Has a scene, a job that ended, a leased one that waits for workers, and a replica of it; what the input
/// before has taken away is made again.
class RequestServer {
 public:
  /// To be made before the process has a second thread.
  RequestServer();
  ~RequestServer();

  /// The input with the names of what there is in the place of placeholders. Aborts when the server no longer
  /// serves.
  std::string with_names(std::string input);
  /// Ends the call after its first answer, or a second.
  grpc::Status call(Call& call);

 private:
  void restore();
  void upload_scene();
  v1::Job create_job(const v1::RenderSettings& settings, bool leased);
  void wait_for(const std::string& job);
  void open_replica();
  void cancel_others();
  bool exists(const std::string& job);

  service::ReaderHost readers_;
  std::filesystem::path folder_;
  std::unique_ptr<service::Server> server_;
  std::shared_ptr<grpc::Channel> channel_;
  std::string scene_;
  std::string cache_;
  std::string blob_;
  std::string ended_job_;
  v1::Job leased_job_;
  std::string replica_;
  uint64_t requests_ = 0;
};

}  // namespace fogbank::fuzz
