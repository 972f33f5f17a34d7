// What callers must be allowed to do for each rpc.
#pragma once

#include <optional>
#include <set>
#include <string>
#include <string_view>

namespace fogbank::service {

/// What a token may be used for. `admin` includes the others.
enum class Scope : uint8_t { render, upload, admin };

/// "render", "upload", "admin"; nullopt for anything else.
std::optional<Scope> scope_of(std::string_view name);
std::string_view name_of(Scope scope);

struct Access {
  /// One of these is enough; empty: any token is.
  std::set<Scope> scopes;
  /// It changes something, so that it goes into the audit log.
  bool changes = false;
};

/// By "Service.Method"; nullptr for an rpc that nobody has thought of, which is then nobody's.
const Access* access_of(std::string_view rpc);

}  // namespace fogbank::service
