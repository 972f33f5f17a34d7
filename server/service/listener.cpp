#include "service/listener.h"

#include <grpcpp/security/tls_certificate_provider.h>
#include <grpcpp/security/tls_credentials_options.h>
#include <openssl/ssl.h>

#include <string>

#include "service/limits.h"
#include "service/server.h"

namespace fogbank::service {

namespace {

/// gRPC would listen with whatever it finds and refuse every client; better not to start at all.
void check(const TlsFiles& files) {
  const std::unique_ptr<SSL_CTX, decltype(&SSL_CTX_free)> context(SSL_CTX_new(TLS_server_method()),
                                                                  SSL_CTX_free);
  if (SSL_CTX_use_certificate_chain_file(context.get(), files.certificate.c_str()) != 1)
    throw OptionError("--tls-certificate: " + files.certificate.string() +
                      " is no certificate in PEM format");
  if (SSL_CTX_use_PrivateKey_file(context.get(), files.key.c_str(), SSL_FILETYPE_PEM) != 1 ||
      SSL_CTX_check_private_key(context.get()) != 1) {
    throw OptionError("--tls-key: " + files.key.string() + " is not the key of the certificate");
  }
  if (!files.client_authority.empty() &&
      SSL_CTX_load_verify_locations(context.get(), files.client_authority.c_str(), nullptr) != 1) {
    throw OptionError("--tls-client-ca: " + files.client_authority.string() +
                      " is no certificate in PEM format");
  }
}

}  // namespace

std::shared_ptr<grpc::ServerCredentials> server_credentials(const TlsFiles& files) {
  if (files.certificate.empty()) return grpc::InsecureServerCredentials();
  check(files);
  const auto provider = std::make_shared<grpc::experimental::FileWatcherCertificateProvider>(
      files.key, files.certificate, files.client_authority.string(),
      static_cast<unsigned>(limits::certificate_reload_seconds));
  grpc::experimental::TlsServerCredentialsOptions options(provider);
  options.watch_identity_key_cert_pairs();
  if (files.client_authority.empty()) {
    options.set_cert_request_type(GRPC_SSL_DONT_REQUEST_CLIENT_CERTIFICATE);
  } else {
    options.watch_root_certs();
    options.set_cert_request_type(GRPC_SSL_REQUEST_CLIENT_CERTIFICATE_AND_VERIFY);
  }
  return grpc::experimental::TlsServerCredentials(options);
}

}  // namespace fogbank::service
