#include "service/listen_address.h"

#include <gtest/gtest.h>

#include "service/server.h"

namespace fogbank::service {
namespace {

TEST(ListenAddress, LoopbackAndSocketsNeedNoFlag) {
  for (const char* text : {"127.0.0.1:0", "127.8.9.10:65535", "localhost:7070", "[::1]:7070"}) {
    EXPECT_TRUE(check_listen_address(text, false).is_network) << text;
  }
  EXPECT_FALSE(check_listen_address("unix:/run/fogbank.sock", false).is_network);
}

TEST(ListenAddress, EverythingElseNeedsIt) {
  // 127.0.0.1.example.org resolves to wherever its owner likes.
  for (const char* text : {"0.0.0.0:1", "[::]:1", "192.168.0.1:1", "example.org:1", "127.0.0.1.example.org:1",
                           "[::ffff:127.0.0.1]:1"}) {
    EXPECT_THROW(check_listen_address(text, false), OptionError) << text;
    EXPECT_NO_THROW(check_listen_address(text, true)) << text;
  }
}

TEST(ListenAddress, NonsenseIsRefusedInAnyCase) {
  for (const char* text :
       {"", ":", ":1", "host", "host:", "host:1x", "host:-1", "host:65536", "::1:80", "unix:"}) {
    EXPECT_THROW(check_listen_address(text, true), OptionError) << text;
  }
}

}  // namespace
}  // namespace fogbank::service
