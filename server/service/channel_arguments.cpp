#include "service/channel_arguments.h"

namespace fogbank::service {

std::span<const ChannelArgument> channel_arguments() {
  static constexpr ChannelArgument table[] = {
      {"grpc.keepalive_time_ms", 30000, true, true, "finds a dead peer behind a silent connection"},
      {"grpc.keepalive_timeout_ms", 20000, true, true, "30 s + 20 s: half-open connections end within 60 s"},
      {"grpc.keepalive_permit_without_calls", 1, true, true, "idle clients notice a lost server too"},
      {"grpc.http2.max_pings_without_data", 0, true, true, "a watcher may be silent for long"},
      {"grpc.http2.min_ping_interval_without_data_ms", 10000, false, true,
       "accepts the clients' pings every 30 s with room to spare; the library's 5 minutes would cut them "
       "off"},
      {"grpc.http2.bdp_probe", 0, true, true,
       "keeps the receive window small: with probing 40 stalled streams held 2.3 GiB in a Python client"},
      {"grpc.http2.lookahead_bytes", 65536, true, false,
       "receive window of a stream: a reader that stalls is felt by the server after two tiles"},
      {"grpc.http2.lookahead_bytes", 1 << 20, false, true,
       "receive window of a stream: 10 MB/s of upload at 100 ms round trip, and the most that a client whose "
       "points or files can't be worked on at once makes the server hold"},
      {"grpc.server_handshake_timeout_ms", 20000, false, true,
       "a caller that has not got as far as HTTP/2 by then is hung up on; the library waits 2 minutes"},
      {"grpc.max_concurrent_streams", 1100, false, true, "streams of one connection"},
  };
  return table;
}

}  // namespace fogbank::service
