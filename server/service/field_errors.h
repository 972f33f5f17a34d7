// Errors about a field of a request.
#pragma once

#include <string>

#include "core/error.h"

namespace fogbank::service {

/// Throws RpcError INVALID_SETTINGS with the field in message and metadata.
[[noreturn]] void refuse_field(const std::string& field, const std::string& message);

/// The engine names its fields in front of a colon.
struct EngineFieldError {
  explicit EngineFieldError(const Error& error);

  std::string field;
  std::string message;
};

}  // namespace fogbank::service
