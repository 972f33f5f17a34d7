// Errors as the wire contract has them: canonical code, machine-readable reason, metadata, a message for
// people.
#pragma once

#include <grpcpp/impl/codegen/status_code_enum.h>

#include <exception>
#include <map>
#include <optional>
#include <stdexcept>
#include <string>
#include <utility>

#include "core/error.h"

namespace grpc {
class Status;
}
namespace google::rpc {
class Status;
}

namespace fogbank::service {

/// What an rpc fails with.
class RpcError : public std::runtime_error {
 public:
  using Metadata = std::map<std::string, std::string>;

  RpcError(grpc::StatusCode code, std::string reason, const std::string& message, Metadata metadata = {})
      : std::runtime_error(message),
        code_(code),
        reason_(std::move(reason)),
        metadata_(std::move(metadata)) {}

  grpc::StatusCode code() const { return code_; }
  const std::string& reason() const { return reason_; }
  const Metadata& metadata() const { return metadata_; }
  /// The same, with the time after which asking again may help.
  RpcError retry_after(double seconds) && {
    retry_seconds_ = seconds;
    return std::move(*this);
  }
  std::optional<double> retry_seconds() const { return retry_seconds_; }

 private:
  grpc::StatusCode code_;
  std::string reason_;
  Metadata metadata_;
  std::optional<double> retry_seconds_;
};

/// What calls are answered, and streams ended with, while the server ends.
RpcError shutting_down();

/// Any exception as an RpcError: the engine's errors keep their reason, a SceneError brings file, line and
/// element as metadata; everything that is not a typed error is INTERNAL_ERROR.
RpcError to_rpc_error(const std::exception_ptr& exception);

/// As google.rpc.Status with a google.rpc.ErrorInfo of domain "fogbank" and, where there is a time to retry
/// after, a google.rpc.RetryInfo.
google::rpc::Status to_status_message(const RpcError& error);

/// The reason of such a message; empty where it has none.
std::string reason_of(const google::rpc::Status& status);

/// As the status of an rpc, the message above in its details.
grpc::Status to_grpc_status(const RpcError& error);

}  // namespace fogbank::service
