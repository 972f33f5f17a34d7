#include "service/token_file.h"

#include <openssl/crypto.h>

#include <algorithm>
#include <chrono>
#include <nlohmann/json.hpp>
#include <stdexcept>
#include <utility>

#include "core/sha256.h"
#include "service/rpc_error.h"

namespace fogbank::service {

namespace {

constexpr std::string_view prefix = "fogbank_";

RpcError refused(const char* reason, const char* message) {
  return {grpc::StatusCode::UNAUTHENTICATED, reason, message};
}

}  // namespace

bool is_tenant_name(std::string_view name) {
  return !name.empty() && name.size() <= 32 && name.front() != '-' && std::ranges::all_of(name, [](char c) {
    return (c >= 'a' && c <= 'z') || (c >= '0' && c <= '9') || c == '-';
  });
}

TokenFile::TokenFile(std::filesystem::path path) : file_(std::move(path), &TokenFile::parse) {}

TokenFile::Tokens TokenFile::parse(const std::string& text) {
  const nlohmann::json file = nlohmann::json::parse(text);
  if (file.at("version").get<int>() != 1) throw std::runtime_error("it is of another version");
  Tokens tokens;
  for (const nlohmann::json& entry : file.at("tokens")) {
    Token token;
    const auto id = entry.at("id").get<std::string>();
    token.secret_sha256 = entry.at("sha256").get<std::string>();
    token.identity.tenant = entry.at("tenant").get<std::string>();
    token.identity.by = id;
    if (!is_tenant_name(token.identity.tenant)) throw std::runtime_error("a tenant's name is not one");
    for (const nlohmann::json& name : entry.at("scopes")) {
      const std::optional<Scope> scope = scope_of(name.get<std::string>());
      if (!scope) throw std::runtime_error("a scope is unknown");
      token.identity.scopes.insert(*scope);
    }
    if (!entry.at("expires").is_null()) token.expires = entry.at("expires").get<int64_t>();
    token.revoked = !entry.at("revoked").is_null();
    tokens.emplace(id, std::move(token));
  }
  return tokens;
}

Identity TokenFile::identify(std::string_view token) {
  const RpcError unknown = refused("TOKEN_INVALID", "the token is none of this server's");
  if (!token.starts_with(prefix)) throw unknown;
  token.remove_prefix(prefix.size());
  const size_t end_of_id = token.find('_');
  if (end_of_id == std::string_view::npos) throw unknown;
  const std::string secret_sha256 = sha256(token.substr(end_of_id + 1));

  const std::lock_guard lock(mutex_);
  const Tokens& tokens = file_.get();
  const auto found = tokens.find(token.substr(0, end_of_id));
  if (found == tokens.end()) throw unknown;
  const Token& known = found->second;
  // Ids are no secrets; the rest takes the same time whatever it is.
  if (known.secret_sha256.size() != secret_sha256.size() ||
      CRYPTO_memcmp(known.secret_sha256.data(), secret_sha256.data(), secret_sha256.size()) != 0) {
    throw unknown;
  }
  if (known.revoked) throw refused("TOKEN_REVOKED", "the token was revoked");
  const auto now = std::chrono::system_clock::now().time_since_epoch();
  if (known.expires && std::chrono::duration_cast<std::chrono::seconds>(now).count() >= *known.expires)
    throw refused("TOKEN_EXPIRED", "the token has expired");
  return known.identity;
}

}  // namespace fogbank::service
