#include "service/self_probe.h"

#include <netdb.h>
#include <openssl/ssl.h>
#include <pthread.h>
#include <spdlog/spdlog.h>
#include <sys/socket.h>
#include <sys/time.h>
#include <sys/un.h>

#include <cstring>
#include <memory>
#include <optional>
#include <string_view>
#include <utility>

#include "core/files.h"
#include "service/limits.h"
#include "service/scheduling/clock.h"

namespace fogbank::service {

namespace {

constexpr std::string_view socket_prefix = "unix:";
/// What every HTTP/2 connection begins with, and empty settings: RFC 9113 section 3.4.
constexpr std::string_view preface("PRI * HTTP/2.0\r\n\r\nSM\r\n\r\n\0\0\0\4\0\0\0\0\0", 33);

/// A socket whose operations end after the probe's time; invalid without descriptors.
FileDescriptor make_socket(int family) {
  FileDescriptor socket(::socket(family, SOCK_STREAM | SOCK_CLOEXEC, 0));
  timeval limit{};
  limit.tv_sec = static_cast<time_t>(limits::self_probe_timeout_seconds);
  if (socket.valid()) {
    ::setsockopt(socket.get(), SOL_SOCKET, SO_RCVTIMEO, &limit, sizeof limit);
    ::setsockopt(socket.get(), SOL_SOCKET, SO_SNDTIMEO, &limit, sizeof limit);
  }
  return socket;
}

/// nullopt: there is no descriptor for it. An invalid one: the server can't be reached.
std::optional<FileDescriptor> connect_to(const std::string& target) {
  if (target.starts_with(socket_prefix)) {
    sockaddr_un address{};
    address.sun_family = AF_UNIX;
    target.copy(address.sun_path, sizeof address.sun_path - 1, socket_prefix.size());
    FileDescriptor socket = make_socket(AF_UNIX);
    if (!socket.valid()) return {};
    if (::connect(socket.get(), reinterpret_cast<const sockaddr*>(&address), sizeof address) != 0)
      return FileDescriptor();
    return socket;
  }
  const size_t colon = target.rfind(':');
  std::string host = target.substr(0, colon);
  if (host.starts_with('[')) host = host.substr(1, host.size() - 2);
  addrinfo hints{};
  hints.ai_socktype = SOCK_STREAM;
  hints.ai_flags = AI_NUMERICSERV;
  addrinfo* found = nullptr;
  if (::getaddrinfo(host.c_str(), target.c_str() + colon + 1, &hints, &found) != 0) return {};
  const std::unique_ptr<addrinfo, decltype(&::freeaddrinfo)> addresses(found, &::freeaddrinfo);
  FileDescriptor socket = make_socket(found->ai_family);
  if (!socket.valid()) return {};
  if (::connect(socket.get(), found->ai_addr, found->ai_addrlen) != 0) return FileDescriptor();
  return socket;
}

/// Whether the server says anything, a refusal included.
bool answers(const FileDescriptor& socket) {
  if (::send(socket.get(), preface.data(), preface.size(), MSG_NOSIGNAL) < 0) return errno != EAGAIN;
  char byte = 0;
  return ::recv(socket.get(), &byte, 1, 0) >= 0 || errno != EAGAIN;
}

bool answers_tls(const FileDescriptor& socket) {
  const std::unique_ptr<SSL_CTX, decltype(&SSL_CTX_free)> context(SSL_CTX_new(TLS_client_method()),
                                                                  &SSL_CTX_free);
  const std::unique_ptr<SSL, decltype(&SSL_free)> session(SSL_new(context.get()), &SSL_free);
  SSL_set_fd(session.get(), socket.get());
  constexpr unsigned char protocols[] = {2, 'h', '2'};
  SSL_set_alpn_protos(session.get(), protocols, sizeof protocols);
  const int result = SSL_connect(session.get());
  // Alerts are answers, too; silence ends with the socket's time.
  return result == 1 || SSL_get_error(session.get(), result) == SSL_ERROR_SSL;
}

}  // namespace

SelfProbe::SelfProbe(std::string target, bool tls, std::function<void()> dead)
    : target_(std::move(target)), tls_(tls), dead_(std::move(dead)), thread_([this] { work(); }) {}

SelfProbe::~SelfProbe() {
  {
    const std::lock_guard lock(mutex_);
    stopped_ = true;
  }
  wake_.notify_one();
  thread_.join();
}

void SelfProbe::work() {
  pthread_setname_np(pthread_self(), "self-probe");
  int failures = 0;
  std::unique_lock lock(mutex_);
  while (!wake_.wait_for(lock, seconds(limits::self_probe_seconds), [this] { return stopped_; })) {
    lock.unlock();
    const std::optional<FileDescriptor> socket = connect_to(target_);
    const bool failed = socket && !(socket->valid() && (tls_ ? answers_tls(*socket) : answers(*socket)));
    lock.lock();
    if (!socket) continue;
    failures = failed ? failures + 1 : 0;
    if (failed) spdlog::error("the server does not answer its own connection ({} in a row)", failures);
    if (failures < limits::self_probe_tries) continue;
    dead_();
    return;
  }
}

}  // namespace fogbank::service
