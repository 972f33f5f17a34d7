// Where a server may listen.
#pragma once

#include <string>

namespace fogbank::service {

struct ListenAddress {
  std::string target;       ///< as gRPC takes it
  std::string host;         ///< of a network address, with the brackets of an IPv6 one
  bool is_network = false;  ///< else a unix socket
};

/// Takes HOST:PORT, [IPV6]:PORT or unix:PATH apart. Throws OptionError when it is none of these, and when the
/// host is not loopback and `any_address` is false: whoever reaches the port in the clear could use the
/// server or read along.
ListenAddress check_listen_address(const std::string& text, bool any_address);

}  // namespace fogbank::service
