#include "service/rpc_error.h"

#include <google/protobuf/util/time_util.h>
#include <grpcpp/support/status.h>

#include <cmath>
#include <new>

#include "google/rpc/error_details.pb.h"
#include "google/rpc/status.pb.h"

namespace fogbank::service {

namespace {

/// Messages may quote a scene file; gRPC sends them as a header, where long ones would break the 8 KiB limit.
constexpr size_t max_message_bytes = 2000;
constexpr size_t max_metadata_bytes = 500;

grpc::StatusCode code_of(ErrorKind kind) {
  switch (kind) {
    case ErrorKind::invalid_argument:
      return grpc::StatusCode::INVALID_ARGUMENT;
    case ErrorKind::not_found:
      return grpc::StatusCode::NOT_FOUND;
    case ErrorKind::already_exists:
      return grpc::StatusCode::ALREADY_EXISTS;
    case ErrorKind::failed_precondition:
      return grpc::StatusCode::FAILED_PRECONDITION;
    case ErrorKind::resource_exhausted:
      return grpc::StatusCode::RESOURCE_EXHAUSTED;
    case ErrorKind::unsupported:
      return grpc::StatusCode::UNIMPLEMENTED;
    case ErrorKind::cancelled:
      return grpc::StatusCode::CANCELLED;
    case ErrorKind::data_loss:
      return grpc::StatusCode::DATA_LOSS;
    case ErrorKind::internal:
      break;
  }
  return grpc::StatusCode::INTERNAL;
}

/// At most `limit` bytes, cut between characters, and valid UTF-8, as protobuf strings must be; control
/// characters (a file name may hold them) become spaces.
std::string presentable(const std::string& text, size_t limit) {
  std::string result;
  for (size_t i = 0; i < text.size();) {
    const auto lead = static_cast<unsigned char>(text[i]);
    const size_t length = lead < 0x80                   ? 1
                          : lead >= 0xc2 && lead < 0xe0 ? 2
                          : (lead & 0xf0) == 0xe0       ? 3
                          : lead >= 0xf0 && lead < 0xf5 ? 4
                                                        : 0;
    bool valid = length > 0 && i + length <= text.size();
    for (size_t k = 1; valid && k < length; ++k)
      valid = (static_cast<unsigned char>(text[i + k]) & 0xc0) == 0x80;
    if (result.size() + (valid ? length : 1) > limit) return result + "...";
    if (!valid) {
      result += '?';
      ++i;
      continue;
    }
    if (lead < 0x20 && lead != '\n') {
      result += ' ';
    } else {
      result.append(text, i, length);
    }
    i += length;
  }
  return result;
}

}  // namespace

RpcError shutting_down() {
  return {grpc::StatusCode::UNAVAILABLE, "SHUTTING_DOWN", "the server is shutting down"};
}

RpcError to_rpc_error(const std::exception_ptr& exception) {
  try {
    std::rethrow_exception(exception);
  } catch (const RpcError& error) {
    return error;
  } catch (const SceneError& error) {
    const SourceLocation& where = error.where();
    return {code_of(error.kind()),
            error.reason(),
            error.what(),
            {{"file", where.file}, {"line", std::to_string(where.line)}, {"element", where.element}}};
  } catch (const Error& error) {
    return {code_of(error.kind()), error.reason(), error.what()};
  } catch (const std::bad_alloc&) {
    return {grpc::StatusCode::RESOURCE_EXHAUSTED, "OUT_OF_MEMORY", "out of memory"};
  } catch (const std::exception& error) {
    return {grpc::StatusCode::INTERNAL, "INTERNAL_ERROR", std::string("internal error: ") + error.what()};
  } catch (...) {
    return {grpc::StatusCode::INTERNAL, "INTERNAL_ERROR", "internal error"};
  }
}

google::rpc::Status to_status_message(const RpcError& error) {
  google::rpc::ErrorInfo info;
  info.set_reason(error.reason());
  info.set_domain("fogbank");
  for (const auto& [key, value] : error.metadata()) {
    (*info.mutable_metadata())[key] = presentable(value, max_metadata_bytes);
  }
  google::rpc::Status status;
  status.set_code(error.code());
  status.set_message(presentable(error.what(), max_message_bytes));
  status.add_details()->PackFrom(info);
  if (error.retry_seconds()) {
    google::rpc::RetryInfo retry;
    *retry.mutable_retry_delay() =
        google::protobuf::util::TimeUtil::MillisecondsToDuration(std::llround(1000 * *error.retry_seconds()));
    status.add_details()->PackFrom(retry);
  }
  return status;
}

std::string reason_of(const google::rpc::Status& status) {
  google::rpc::ErrorInfo info;
  if (status.details_size() == 0 || !status.details(0).UnpackTo(&info)) return "";
  return info.reason();
}

grpc::Status to_grpc_status(const RpcError& error) {
  const google::rpc::Status status = to_status_message(error);
  return {error.code(), status.message(), status.SerializeAsString()};
}

}  // namespace fogbank::service
