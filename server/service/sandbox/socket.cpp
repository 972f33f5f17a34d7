#include "service/sandbox/socket.h"

#include <sys/socket.h>

#include <cerrno>
#include <cstring>

namespace fogbank::service {
namespace {

/// Room for one descriptor, aligned as the kernel wants it.
union ControlBuffer {
  cmsghdr header;
  char bytes[CMSG_SPACE(sizeof(int))];
};

}  // namespace

std::pair<Socket, Socket> Socket::make_pair() {
  int ends[2];
  if (::socketpair(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0, ends) != 0)
    throw_file_error(errno, "opening", "a socket");
  // The kernel's default buffer makes both sides wait for each other every 100 kB.
  const int buffer_bytes = 4 << 20;
  for (const int end : ends) ::setsockopt(end, SOL_SOCKET, SO_SNDBUF, &buffer_bytes, sizeof buffer_bytes);
  return {Socket(FileDescriptor(ends[0])), Socket(FileDescriptor(ends[1]))};
}

void Socket::set_patience(int64_t seconds) const {
  const timeval patience{.tv_sec = seconds, .tv_usec = 0};
  ::setsockopt(descriptor_.get(), SOL_SOCKET, SO_RCVTIMEO, &patience, sizeof patience);
  ::setsockopt(descriptor_.get(), SOL_SOCKET, SO_SNDTIMEO, &patience, sizeof patience);
}

void Socket::send(const void* bytes, size_t size) const {
  const auto* at = static_cast<const char*>(bytes);
  while (size > 0) {
    const ssize_t sent = ::send(descriptor_.get(), at, size, MSG_NOSIGNAL);
    if (sent < 0 && errno == EINTR) continue;
    if (sent < 0 && errno == EAGAIN) throw SocketSilent();
    if (sent <= 0) throw SocketClosed();
    at += sent;
    size -= static_cast<size_t>(sent);
  }
}

void Socket::receive(void* bytes, size_t size) const {
  auto* at = static_cast<char*>(bytes);
  while (size > 0) {
    const ssize_t received = ::recv(descriptor_.get(), at, size, 0);
    if (received < 0 && errno == EINTR) continue;
    if (received < 0 && errno == EAGAIN) throw SocketSilent();
    if (received <= 0) throw SocketClosed();
    at += received;
    size -= static_cast<size_t>(received);
  }
}

void Socket::send_file(int descriptor) const {
  char byte = 0;
  iovec data{.iov_base = &byte, .iov_len = 1};
  ControlBuffer control{};
  msghdr message{};
  message.msg_iov = &data;
  message.msg_iovlen = 1;
  message.msg_control = control.bytes;
  message.msg_controllen = sizeof control.bytes;
  cmsghdr* const header = CMSG_FIRSTHDR(&message);
  header->cmsg_level = SOL_SOCKET;
  header->cmsg_type = SCM_RIGHTS;
  header->cmsg_len = CMSG_LEN(sizeof(int));
  std::memcpy(CMSG_DATA(header), &descriptor, sizeof(int));
  ssize_t sent = 0;
  do {
    sent = ::sendmsg(descriptor_.get(), &message, MSG_NOSIGNAL);
  } while (sent < 0 && errno == EINTR);
  if (sent != 1) throw SocketClosed();
}

FileDescriptor Socket::receive_file() const {
  char byte = 0;
  iovec data{.iov_base = &byte, .iov_len = 1};
  ControlBuffer control{};
  msghdr message{};
  message.msg_iov = &data;
  message.msg_iovlen = 1;
  message.msg_control = control.bytes;
  message.msg_controllen = sizeof control.bytes;
  ssize_t received = 0;
  do {
    received = ::recvmsg(descriptor_.get(), &message, MSG_CMSG_CLOEXEC);
  } while (received < 0 && errno == EINTR);
  const cmsghdr* const header = received == 1 ? CMSG_FIRSTHDR(&message) : nullptr;
  if (header == nullptr || header->cmsg_type != SCM_RIGHTS) throw SocketClosed();
  int descriptor = -1;
  std::memcpy(&descriptor, CMSG_DATA(header), sizeof(int));
  return FileDescriptor(descriptor);
}

}  // namespace fogbank::service
