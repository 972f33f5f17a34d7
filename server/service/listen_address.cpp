#include "service/listen_address.h"

#include <arpa/inet.h>

#include <charconv>

#include "service/server.h"

namespace fogbank::service {

namespace {

bool is_loopback(const std::string& host) {
  if (host == "localhost") return true;
  in_addr v4{};
  if (::inet_pton(AF_INET, host.c_str(), &v4) == 1) return (ntohl(v4.s_addr) >> 24) == 127;
  in6_addr v6{};
  if (host.size() > 2 && host.front() == '[' &&
      ::inet_pton(AF_INET6, host.substr(1, host.size() - 2).c_str(), &v6) == 1) {
    return IN6_IS_ADDR_LOOPBACK(&v6);
  }
  return false;
}

}  // namespace

ListenAddress check_listen_address(const std::string& text, bool any_address) {
  if (text.starts_with("unix:")) {
    // sun_path has 108 bytes, the terminating zero included.
    const size_t length = text.size() - 5;
    if (length == 0 || length > 107) throw OptionError("--listen: the path of a socket has 1 to 107 bytes");
    return {.target = text, .host = "", .is_network = false};
  }
  const size_t colon = text.rfind(':');
  const std::string host = text.substr(0, colon == std::string::npos ? 0 : colon);
  const std::string digits = colon == std::string::npos ? "" : text.substr(colon + 1);
  unsigned port = 0;
  const auto [end, error] = std::from_chars(digits.data(), digits.data() + digits.size(), port);
  const bool bracketed = !host.empty() && host.front() == '[' && host.back() == ']';
  if (host.empty() || digits.empty() || error != std::errc() || end != digits.data() + digits.size() ||
      port > 65535 || (host.find(':') != std::string::npos && !bracketed)) {
    throw OptionError("--listen: \"" + text + "\" is not HOST:PORT, [IPV6]:PORT or unix:PATH");
  }
  if (!any_address && !is_loopback(host)) {
    throw OptionError(
        "--listen: " + host +
        " can be reached by others; give a certificate (--tls-certificate, --tls-key; `fogbank tls init` "
        "makes "
        "them), listen on 127.0.0.1 or a unix socket, or say --insecure-any-address to allow everybody "
        "everything");
  }
  return {.target = text, .host = host, .is_network = true};
}

}  // namespace fogbank::service
