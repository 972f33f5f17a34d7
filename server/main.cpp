// fogbankd: renders scenes with fog as a gRPC service.
//
// Exit codes: 0 stopped by SIGTERM, SIGINT or the end of standard input; 1 an error while starting; 3 nobody
// could connect any more, and it is to be started again; 64 and
// above as CLI11 and require_processor.cpp give them.
#include <poll.h>
#include <pthread.h>
#include <spdlog/sinks/stdout_color_sinks.h>
#include <spdlog/spdlog.h>
#include <sys/signalfd.h>
#include <unistd.h>

#include <CLI/CLI.hpp>
#include <csignal>
#include <cstdio>
#include <filesystem>
#include <memory>
#include <string>
#include <string_view>

#include "core/files.h"
#include "service/json_log.h"
#include "service/sandbox/reader.h"
#include "service/server.h"

namespace {

/// Blocks the signals that end the server, in this thread and all that it starts, and makes a descriptor of
/// them.
int catch_end_signals() {
  sigset_t signals;
  sigemptyset(&signals);
  sigaddset(&signals, SIGTERM);
  sigaddset(&signals, SIGINT);
  pthread_sigmask(SIG_BLOCK, &signals, nullptr);
  std::signal(SIGPIPE, SIG_IGN);
  return ::signalfd(-1, &signals, SFD_CLOEXEC);
}

/// Returns when a signal comes or, if `watch_stdin`, when standard input is closed at its other end.
void wait_for_end(int signals, bool watch_stdin) {
  while (true) {
    pollfd waits[2] = {{.fd = signals, .events = POLLIN, .revents = 0},
                       {.fd = watch_stdin ? STDIN_FILENO : -1, .events = POLLIN, .revents = 0}};
    if (::poll(waits, 2, -1) < 0) continue;
    if (waits[0].revents != 0) return;
    char ignored[256];
    if (waits[1].revents != 0 && ::read(STDIN_FILENO, ignored, sizeof ignored) <= 0) return;
  }
}

}  // namespace

int main(int argc, char** argv) {
  using fogbank::service::ReaderHost;
  if (argc == 2 && std::string_view(argv[1]) == ReaderHost::argument)
    return ReaderHost::run_as_host(fogbank::service::read_scene_files);

  fogbank::service::ServerOptions options;
  std::filesystem::path port_file;
  bool exit_with_stdin = false;
  std::string data;
  std::string scene_root;
  std::string log_level = "info";
  std::string log_format = "text";
  std::string trace;
  std::string tls_certificate;
  std::string tls_key;
  std::string tls_client_ca;
  double memory_gib = 0;
  double cache_gib = 0;

  CLI::App app{"Fogbank " FOGBANK_VERSION ": renders scenes with fog as a gRPC service.", "fogbankd"};
  app.add_option("--listen", options.listen, "HOST:PORT (port 0: any free one) or unix:PATH")
      ->capture_default_str();
  app.add_option("--data", data, "Data directory: uploaded files, scenes, jobs")->required();
  app.add_option("--scene-root", scene_root, "Folder whose scenes clients may load by path, without upload");
  app.add_option("--threads", options.threads, "Render threads; 0: one for each core")
      ->check(CLI::Range(0, 4096))
      ->capture_default_str();
  app.add_option("--memory", memory_gib,
                 "GiB for scenes, caches and films; 0: three quarters of the machine's memory")
      ->check(CLI::Range(0.0, 1e6))
      ->capture_default_str();
  app.add_option(
         "--cache-disk", cache_gib,
         "GiB that radiance caches may take on the disk; the least recently used go first; 0: no limit")
      ->check(CLI::Range(0.0, 1e6))
      ->capture_default_str();
  app.add_option("--port-file", port_file, "Written when the server is ready: what clients connect to");
  app.add_flag("--exit-with-stdin", exit_with_stdin,
               "Ends when standard input is closed: with the parent process, and its jobs with it");
  app.add_option("--metrics", options.metrics, "HOST:PORT of loopback: serves /metrics to Prometheus");
  app.add_option("--trace", trace,
                 "File for the spans of jobs, fills and probes, OTLP/JSON lines; clients' traceparent says "
                 "what they belong to");
  app.add_option("--task-report", options.task_limits.report_seconds,
                 "Seconds after which a tile is reported as slow, in the log and in metrics")
      ->check(CLI::PositiveNumber)
      ->capture_default_str();
  app.add_option("--task-limit", options.task_limits.limit_seconds,
                 "Seconds after which a tile that has not ended ends its job")
      ->check(CLI::PositiveNumber)
      ->capture_default_str();
  app.add_option("--tls-certificate", tls_certificate,
                 "PEM file: encrypts, on any address, and asks every caller for a token");
  app.add_option("--tls-key", tls_key, "PEM file: the certificate's private key");
  app.add_option("--tls-client-ca", tls_client_ca,
                 "PEM file: clients with a certificate that this authority has signed need no token");
  app.add_flag("--require-tokens", options.require_tokens,
               "Asks every caller for a token, on loopback and sockets, too");
  app.add_flag("--insecure-any-address", options.insecure_any_address,
               "Allows addresses that others can reach without TLS and tokens");
  app.add_option("--log-level", log_level, "debug, info, warning, error, off")
      ->check(CLI::IsMember({"debug", "info", "warning", "error", "off"}))
      ->capture_default_str();
  app.add_option("--log-format", log_format, "text, or json: an object a line")
      ->check(CLI::IsMember({"text", "json"}))
      ->capture_default_str();
  app.set_version_flag("--version", FOGBANK_VERSION);
  CLI11_PARSE(app, argc, argv);

  options.data = data;
  if (tls_certificate.empty() != tls_key.empty() || (tls_certificate.empty() && !tls_client_ca.empty())) {
    std::fputs("fogbankd: error: --tls-certificate, --tls-key and --tls-client-ca belong together\n", stderr);
    return 1;
  }
  options.tls = {.certificate = tls_certificate, .key = tls_key, .client_authority = tls_client_ca};
  options.trace = trace;
  options.jobs_outlive_server = !exit_with_stdin;
  if (!scene_root.empty()) options.scene_root = scene_root;
  options.memory_bytes = static_cast<int64_t>(memory_gib * (1 << 30));
  options.cache_bytes = static_cast<int64_t>(cache_gib * (1 << 30));
  spdlog::set_default_logger(spdlog::stderr_color_mt("fogbankd"));
  if (log_format == "json") spdlog::set_formatter(std::make_unique<fogbank::service::JsonFormatter>());
  spdlog::set_level(spdlog::level::from_str(log_level));

  try {
    ReaderHost readers(fogbank::service::read_scene_files);  // before the first thread
    const int signals = catch_end_signals();
    fogbank::service::Server server(options, readers);
    spdlog::info("fogbankd {} listens on {}", FOGBANK_VERSION, server.target());
    if (!port_file.empty()) fogbank::write_file_durably(port_file, server.target() + "\n");
    wait_for_end(signals, exit_with_stdin);
    spdlog::info("stopping");
    server.stop();
    return server.exit_code();
  } catch (const std::exception& error) {
    std::fprintf(stderr, "fogbankd: error: %s\n", error.what());
    return 1;
  }
}
