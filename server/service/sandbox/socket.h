// A connected pair of unix sockets: bytes and open files between the server and the processes that read
// scenes.
#pragma once

#include <cstddef>
#include <cstdint>
#include <stdexcept>
#include <string>
#include <string_view>
#include <utility>

#include "core/files.h"

namespace fogbank::service {

/// The other end is closed: its process has ended.
class SocketClosed : public std::runtime_error {
 public:
  SocketClosed() : std::runtime_error("the other process has ended") {}
};

/// The other end has said nothing for longer than `set_patience`.
class SocketSilent : public std::runtime_error {
 public:
  SocketSilent() : std::runtime_error("the other process says nothing") {}
};

/// One end. Blocks; throws SocketClosed, SocketSilent.
class Socket {
 public:
  Socket() = default;
  explicit Socket(FileDescriptor descriptor) : descriptor_(std::move(descriptor)) {}

  static std::pair<Socket, Socket> make_pair();

  void send(const void* bytes, size_t size) const;
  void send(std::string_view bytes) const { send(bytes.data(), bytes.size()); }
  void receive(void* bytes, size_t size) const;
  template <typename T>
  void send_value(const T& value) const {
    send(&value, sizeof(T));
  }
  template <typename T>
  T receive_value() const {
    T value;
    receive(&value, sizeof(T));
    return value;
  }
  void send_file(int descriptor) const;
  FileDescriptor receive_file() const;

  void set_patience(int64_t seconds) const;

  int get() const { return descriptor_.get(); }
  bool valid() const { return descriptor_.valid(); }
  void close() { descriptor_.close(); }

 private:
  FileDescriptor descriptor_;
};

/// A message: what it is, and its length, before its bytes.
struct MessageHeader {
  uint32_t kind = 0;
  uint32_t reserved = 0;
  uint64_t bytes = 0;
};

}  // namespace fogbank::service
