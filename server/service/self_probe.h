// Connects to the server as a client does, to see whether it still takes connections.
#pragma once

#include <condition_variable>
#include <functional>
#include <mutex>
#include <string>
#include <thread>

namespace fogbank::service {

/// This gRPC version never accepts again once file descriptors have run out (CVE-2023-4785): the process
/// lives, health says SERVING to those who are connected, and nobody gets in. A thread connects every
/// limits::self_probe_seconds and waits for the server's first bytes; after limits::self_probe_tries failures
/// in a row it calls `dead`, once. A descriptor of its own that it can't get is no failure: the server could
/// get none either, and may take connections again when there are some.
class SelfProbe {
 public:
  /// `target` as gRPC takes it: HOST:PORT or unix:PATH.
  SelfProbe(std::string target, bool tls, std::function<void()> dead);
  ~SelfProbe();

 private:
  void work();

  const std::string target_;
  const bool tls_;
  const std::function<void()> dead_;
  std::mutex mutex_;
  std::condition_variable wake_;
  bool stopped_ = false;
  std::thread thread_;
};

}  // namespace fogbank::service
