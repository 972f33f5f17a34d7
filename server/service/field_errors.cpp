#include "service/field_errors.h"

#include "service/rpc_error.h"

namespace fogbank::service {

void refuse_field(const std::string& field, const std::string& message) {
  throw RpcError(grpc::StatusCode::INVALID_ARGUMENT, "INVALID_SETTINGS", field + ": " + message,
                 {{"field", field}});
}

EngineFieldError::EngineFieldError(const Error& error) : message(error.what()) {
  const size_t colon = message.find(": ");
  field = message.substr(0, colon);
  if (colon != std::string::npos) message.erase(0, colon + 2);
}

}  // namespace fogbank::service
