// fogbankd as an object: everything it consists of, in the order of its life.
#pragma once

#include <atomic>
#include <filesystem>
#include <memory>
#include <optional>
#include <stdexcept>
#include <string>

#include "service/listener.h"
#include "service/sandbox/reader_host.h"
#include "service/task_limits.h"

namespace fogbank::service {

struct ServerOptions {
  std::string listen = "127.0.0.1:7070";            ///< HOST:PORT (port 0: any free one) or unix:PATH
  std::filesystem::path data;                       ///< data directory; made if absent
  std::optional<std::filesystem::path> scene_root;  ///< scenes below it may be loaded by path
  int threads = 0;                                  ///< render threads; 0: one for each core
  int64_t memory_bytes = 0;     ///< for scenes, caches and films; 0: three quarters of the machine's
  int64_t cache_bytes = 0;      ///< of caches on the disk; 0: no limit
  TlsFiles tls;                 ///< with a certificate: TLS, and tokens on every address
  std::string metrics;          ///< HOST:PORT of loopback for Prometheus; empty: no metrics
  std::filesystem::path trace;  ///< OTLP/JSON file for spans of jobs, fills and probes; empty: none
  TaskLimits task_limits;
  bool require_tokens = false;        ///< on loopback and sockets, too
  bool insecure_any_address = false;  ///< allows addresses other than loopback and sockets without either
  /// Jobs that have not ended when the server does go on with its next life. Else they are cancelled: their
  /// client ends, too.
  bool jobs_outlive_server = true;
};

/// Refused options (a message for people; the program ends with a usage error).
class OptionError : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

class Server {
 public:
  /// Of a server that nobody could connect to any more; it asked for its end by SIGTERM.
  static constexpr int exit_code_of_the_dead = 3;

  /// Starts and serves. Throws OptionError for options that are refused: an address that others can reach
  /// without TLS or `insecure_any_address`, one that is in use, files that are no certificate, a data
  /// directory that another server has or that can't be used.
  Server(const ServerOptions& options, ReaderHost& readers);
  /// As `stop`.
  ~Server();

  /// What clients connect to: HOST:PORT or unix:PATH.
  const std::string& target() const;

  /// Takes no new jobs, suspends or cancels the others, gives watchers the time to hear of it, and ends
  /// within limits::drain_seconds + limits::shutdown_seconds.
  void stop();

  /// What the process is to end with after `stop`: 0, or `exit_code_of_the_dead`.
  int exit_code() const { return dead_ ? exit_code_of_the_dead : 0; }

 private:
  struct Parts;

  std::atomic<bool> dead_ = false;  ///< as the self-probe has found
  std::unique_ptr<Parts> parts_;
};

}  // namespace fogbank::service
