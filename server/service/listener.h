// How a server listens: in the clear where only this machine's users are, else with TLS.
#pragma once

#include <grpcpp/security/server_credentials.h>

#include <filesystem>
#include <memory>

namespace fogbank::service {

/// Files in PEM format.
struct TlsFiles {
  std::filesystem::path certificate;  ///< the server's, with the chain up to its authority; empty: no TLS
  std::filesystem::path key;
  std::filesystem::path client_authority;  ///< who signs clients' certificates; empty: clients need none
};

/// TLS 1.2 and 1.3, with files that are read again every `limits::certificate_reload_seconds`; in the clear
/// without a certificate. Throws OptionError for files that are missing or no certificate and its key.
std::shared_ptr<grpc::ServerCredentials> server_credentials(const TlsFiles& files);

}  // namespace fogbank::service
