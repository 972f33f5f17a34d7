// gRPC channel arguments of server and clients, in one table, since the two ends must agree: a server that
// forbids what a client pings closes the connection with "too_many_pings".
#pragma once

#include <cstdint>
#include <span>

namespace fogbank::service {

struct ChannelArgument {
  const char* name;
  int32_t value;
  bool client;  ///< set on channels; GetCapabilities hands these out
  bool server;  ///< set on the server
  const char* description;
};

std::span<const ChannelArgument> channel_arguments();

}  // namespace fogbank::service
