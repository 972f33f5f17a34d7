// The bearer tokens that a server accepts, as `fogbank token` writes them.
#pragma once

#include <cstdint>
#include <filesystem>
#include <map>
#include <mutex>
#include <optional>
#include <set>
#include <string>
#include <string_view>

#include "service/access.h"
#include "service/watched_file.h"

namespace fogbank::service {

/// Who a caller is, and what they may do.
struct Identity {
  std::string tenant;
  std::set<Scope> scopes;
  std::string by;  ///< token id, or "certificate"; no secret
};

/// 1 to 32 characters of [a-z0-9-], not '-' first: they become folders' names.
bool is_tenant_name(std::string_view name);

/// `tokens.json`: {"version": 1, "tokens": [{"id", "sha256", "tenant", "scopes", "expires", "revoked"}]},
/// times in seconds since 1970 or null; `sha256` is that of the secret, so that the file lets nobody in.
/// Looked at again when it changes, at most a second later. While it can't be read, the tokens from before
/// count. Thread-safe.
class TokenFile {
 public:
  explicit TokenFile(std::filesystem::path path);

  /// The identity of "fogbank_{id}_{secret}". Throws RpcError UNAUTHENTICATED: TOKEN_INVALID for one that
  /// this server never gave out, TOKEN_EXPIRED, TOKEN_REVOKED.
  Identity identify(std::string_view token);

 private:
  struct Token {
    std::string secret_sha256;
    Identity identity;
    std::optional<int64_t> expires;
    bool revoked = false;
  };
  using Tokens = std::map<std::string, Token, std::less<>>;  ///< by id

  static Tokens parse(const std::string& text);

  std::mutex mutex_;
  WatchedFile<Tokens> file_;
};

}  // namespace fogbank::service
