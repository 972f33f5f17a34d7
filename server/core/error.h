// Typed errors of the engine. The service maps `ErrorKind` to a canonical gRPC code and `reason` to
// ErrorInfo.reason.
#pragma once

#include <stdexcept>
#include <string>

namespace fogbank {

enum class ErrorKind {
  invalid_argument,  ///< the input is wrong and stays wrong
  not_found,         ///< a named thing does not exist
  already_exists,
  failed_precondition,  ///< valid, but not in this state
  resource_exhausted,   ///< over a limit
  unsupported,          ///< valid in the scene language, not in this version
  cancelled,
  data_loss,  ///< stored data is damaged
  internal,   ///< a bug of ours
};

/// An error with a machine-readable reason (UPPER_SNAKE_CASE, stable) and a message for people.
class Error : public std::runtime_error {
 public:
  Error(ErrorKind kind, std::string reason, const std::string& message)
      : std::runtime_error(message), kind_(kind), reason_(std::move(reason)) {}

  ErrorKind kind() const { return kind_; }
  const std::string& reason() const { return reason_; }

 private:
  ErrorKind kind_;
  std::string reason_;
};

/// Where in a scene file something stands.
struct SourceLocation {
  std::string file;     ///< logical path, relative to the scene's root
  int line = 0;         ///< 1-based; 0 when not known
  std::string element;  ///< e.g. `<shape type="obj" id="wall">`

  /// "file:line: element"
  std::string to_string() const;
};

/// An error in a scene file; the message begins with "file:line: <element>: ".
class SceneError : public Error {
 public:
  SceneError(ErrorKind kind, std::string reason, const SourceLocation& where, const std::string& message)
      : Error(kind, std::move(reason), where.to_string() + ": " + message), where_(where) {}

  const SourceLocation& where() const { return where_; }

 private:
  SourceLocation where_;
};

}  // namespace fogbank
