#include "service/server.h"

#include <fcntl.h>
#include <grpcpp/ext/proto_server_reflection_plugin.h>
#include <grpcpp/grpcpp.h>
#include <grpcpp/health_check_service_interface.h>
#include <spdlog/spdlog.h>
#include <sys/file.h>
#include <sys/resource.h>
#include <unistd.h>

#include <algorithm>
#include <condition_variable>
#include <csignal>
#include <cstdlib>
#include <thread>

#include "core/files.h"
#include "grpc/health/v1/health.pb.h"
#include "scene/intersector.h"
#include "service/cache_service.h"
#include "service/channel_arguments.h"
#include "service/farm_service.h"
#include "service/flatland_service.h"
#include "service/limits.h"
#include "service/listen_address.h"
#include "service/metrics.h"
#include "service/probe_service.h"
#include "service/render_service.h"
#include "service/scene_service.h"
#include "service/self_probe.h"
#include "service/server_service.h"
#include "service/tenants.h"

namespace fogbank::service {

namespace fs = std::filesystem;

namespace {

/// What all connections together may have received and not yet handed on; a thousand stalled watchers need 40
/// MiB.
constexpr size_t connection_bytes = size_t{256} << 20;

/// This gRPC version never accepts again once descriptors have run out, so there should be many.
void raise_descriptor_limit() {
  rlimit limit{};
  if (::getrlimit(RLIMIT_NOFILE, &limit) != 0) return;
  limit.rlim_cur = limit.rlim_max;
  ::setrlimit(RLIMIT_NOFILE, &limit);
}

/// The data directory, ours alone for as long as the descriptor is open.
FileDescriptor lock_data_directory(const fs::path& data) {
  try {
    create_folder_durably(data);
    FileDescriptor file = open_file(data / "lock", O_RDWR | O_CREAT);
    if (::flock(file.get(), LOCK_EX | LOCK_NB) != 0) {
      throw OptionError("the data directory " + data.string() + " is in use by another fogbankd");
    }
    return file;
  } catch (const OptionError&) {
    throw;
  } catch (const std::exception& error) {
    throw OptionError("the data directory " + data.string() + " can't be used: " + error.what());
  }
}

fs::path checked_scene_root(const fs::path& root) {
  std::error_code error;
  fs::path real = fs::canonical(root, error);
  if (error || !fs::is_directory(real))
    throw OptionError("the scene root " + root.string() + " is no folder");
  return real;
}

int64_t default_memory_bytes() {
  const int64_t physical = static_cast<int64_t>(::sysconf(_SC_PHYS_PAGES)) * ::sysconf(_SC_PAGESIZE);
  return physical / 4 * 3;
}

int default_threads() { return static_cast<int>(std::max(1u, std::thread::hardware_concurrency())); }

/// Looks after quotas and running tasks, once a second, and removes what nobody needs any more.
class Sweeper {
 public:
  explicit Sweeper(const Tenants& tenants) : thread_([this, &tenants] { work(tenants); }) {}
  ~Sweeper() {
    {
      const std::lock_guard lock(mutex_);
      stopped_ = true;
    }
    wake_.notify_one();
    thread_.join();
  }

 private:
  void work(const Tenants& tenants) {
    Clock::time_point next_sweep = Clock::now() + seconds(limits::sweep_seconds);
    std::unique_lock lock(mutex_);
    while (!wake_.wait_for(lock, std::chrono::seconds(1), [this] { return stopped_; })) {
      const bool sweep = Clock::now() >= next_sweep;
      if (sweep) next_sweep = Clock::now() + seconds(limits::sweep_seconds);
      for (Tenant* const tenant : tenants.all()) {
        tenant->quota.tick();
        tenant->jobs.watch_tasks();
        if (sweep) tenant->sweep();
      }
    }
  }

  std::mutex mutex_;
  std::condition_variable wake_;
  bool stopped_ = false;
  std::thread thread_;
};

/// How well scene files are kept apart: containers may forbid layers.
void log_confinement(ReaderHost& readers) {
  try {
    std::string in_force;
    for (const ConfinementLayer& layer : layers_of(readers.start_reader().confinement)) {
      if (layer.problem.empty()) {
        in_force += (in_force.empty() ? "" : ", ") + std::string(layer.name);
      } else {
        spdlog::warn("processes that read scene files go without {}: {}", layer.name, layer.problem);
      }
    }
    spdlog::info("processes that read scene files are confined by {}", in_force);
  } catch (const std::exception& error) {
    spdlog::error("no scene can be loaded: {}", error.what());
  }
}

/// Whom nobody can reach from elsewhere needs no name, unless that is asked for.
bool needs_authentication(const ServerOptions& options) {
  return options.require_tokens || !options.tls.certificate.empty();
}

}  // namespace

/// In the order of construction; what comes later uses what comes before. The queues are closed by `stop`
/// when nothing can post to them any more.
struct Server::Parts {
  Parts(const ServerOptions& options, ReaderHost& readers)
      : lock(lock_data_directory(options.data)),
        memory_bytes(options.memory_bytes > 0 ? options.memory_bytes : default_memory_bytes()),
        control("control", 2),
        files("files", 2),
        writer("writer", 1),
        loader("loader", 1),
        scheduler(options.threads > 0 ? options.threads : default_threads(), scene::prepare_render_thread),
        films(memory_bytes / 4),
        traces(options.trace.empty() ? nullptr : std::make_unique<TraceLog>(options.trace)),
        tenants({.data = options.data,
                 .authentication = needs_authentication(options),
                 .memory_bytes = memory_bytes / 4 * 3,
                 .tenant = {.scene_root = options.scene_root
                                              ? std::optional(checked_scene_root(*options.scene_root))
                                              : std::nullopt,
                            .cache_disk_bytes = options.cache_bytes,
                            .jobs_outlive_server = options.jobs_outlive_server,
                            .task_limits = options.task_limits}},
                control, writer, loader, readers, scheduler, films, traces.get()),
        scene_service(tenants, control, files),
        render_service(tenants, control, files),
        probe_service(tenants, control),
        flatland_service(tenants, control, scheduler),
        cache_service(tenants, files),
        farm_service(tenants, control, files, scheduler),
        server_service(tenants, options.scene_root.has_value(), options.data, memory_bytes, scheduler,
                       readers, control) {}

  FileDescriptor lock;
  int64_t memory_bytes;
  TaskQueue control;
  TaskQueue files;
  TaskQueue writer;
  TaskQueue loader;
  Scheduler scheduler;
  FilmBudget films;
  std::unique_ptr<TraceLog> traces;
  Tenants tenants;
  SceneServiceImplementation scene_service;
  RenderServiceImplementation render_service;
  ProbeServiceImplementation probe_service;
  FlatlandServiceImplementation flatland_service;
  CacheServiceImplementation cache_service;
  FarmServiceImplementation farm_service;
  ServerServiceImplementation server_service;
  std::optional<Sweeper> sweeper;
  std::optional<MetricsEndpoint> metrics;
  std::optional<SelfProbe> self_probe;
  std::unique_ptr<grpc::Server> server;
  std::string target;
};

Server::Server(const ServerOptions& options, ReaderHost& readers) {
  const ListenAddress address =
      check_listen_address(options.listen, options.insecure_any_address || !options.tls.certificate.empty());
  const auto credentials = server_credentials(options.tls);
  if (!options.metrics.empty() &&
      !check_listen_address(options.metrics, options.insecure_any_address).is_network) {
    throw OptionError("--metrics: Prometheus wants HOST:PORT");
  }
  raise_descriptor_limit();
  parts_ = std::make_unique<Parts>(options, readers);
  parts_->loader.post([&readers] { log_confinement(readers); });

  grpc::EnableDefaultHealthCheckService(true);
  // Health and reflection, which shows the public contract, are all that needs no token.
  grpc::reflection::InitProtoReflectionServerBuilderPlugin();
  // The library's health service brings no descriptor; naming ours links it into the program, for reflection.
  grpc::health::v1::HealthCheckRequest::descriptor();

  // Before the first call, which might ask for a job of an earlier life.
  parts_->tenants.open_known();

  grpc::ServerBuilder builder;
  int port = 0;
  builder.AddListeningPort(address.target, credentials, &port);
  builder.SetMaxReceiveMessageSize(static_cast<int>(limits::max_request_bytes));
  // This gRPC version refuses a message that is too large only once it has all of it.
  builder.SetResourceQuota(grpc::ResourceQuota("connections").Resize(connection_bytes));
  for (const ChannelArgument& argument : channel_arguments()) {
    if (argument.server) builder.AddChannelArgument(argument.name, argument.value);
  }
  // Two servers on one port would each get half of the connections.
  builder.AddChannelArgument(GRPC_ARG_ALLOW_REUSEPORT, 0);
  builder.RegisterService(&parts_->scene_service);
  builder.RegisterService(&parts_->render_service);
  builder.RegisterService(&parts_->probe_service);
  builder.RegisterService(&parts_->flatland_service);
  builder.RegisterService(&parts_->cache_service);
  builder.RegisterService(&parts_->farm_service);
  builder.RegisterService(&parts_->server_service);
  parts_->server = builder.BuildAndStart();
  if (!parts_->server || (address.is_network && port == 0)) {
    throw OptionError("can't listen on " + options.listen + ": is the address in use?");
  }
  auto* health = parts_->server->GetHealthCheckService();
  for (const char* service : {v1::SceneService::service_full_name(), v1::RenderService::service_full_name(),
                              v1::ProbeService::service_full_name(), v1::FlatlandService::service_full_name(),
                              v1::CacheService::service_full_name(), v1::FarmService::service_full_name(),
                              v1::ServerService::service_full_name()}) {
    health->SetServingStatus(service, true);
  }
  parts_->target = address.is_network ? address.host + ":" + std::to_string(port) : address.target;
  parts_->sweeper.emplace(parts_->tenants);
  parts_->self_probe.emplace(parts_->target, !options.tls.certificate.empty(), [this] {
    spdlog::critical("the server takes no connections any more and ends, to be started again");
    parts_->server->GetHealthCheckService()->SetServingStatus(false);
    dead_ = true;
    ::kill(::getpid(), SIGTERM);
  });
  if (!options.metrics.empty()) {
    parts_->metrics.emplace(options.metrics, parts_->tenants, parts_->scheduler, readers, options.data);
  }
}

Server::~Server() { stop(); }

const std::string& Server::target() const { return parts_->target; }

void Server::stop() {
  if (!parts_) return;
  Parts& parts = *parts_;
  parts.self_probe.reset();
  const Clock::time_point drain_end = Clock::now() + seconds(limits::drain_seconds);
  if (parts.server) parts.server->GetHealthCheckService()->SetServingStatus(false);
  const std::vector<Tenant*> tenants = parts.tenants.all();
  for (Tenant* const tenant : tenants) tenant->shut_down();
  const auto idle = [&] {
    return parts.loader.idle() &&
           std::ranges::all_of(tenants, [](const Tenant* tenant) { return tenant->idle(); });
  };
  while (!idle() && Clock::now() < drain_end) {
    std::this_thread::sleep_for(std::chrono::milliseconds(10));
  }
  if (parts.server) {
    parts.server->Shutdown(std::chrono::system_clock::now() +
                           std::chrono::milliseconds(static_cast<int64_t>(1000 * limits::shutdown_seconds)));
  }
  const Clock::time_point shutdown_end = Clock::now() + seconds(limits::shutdown_seconds);
  while (parts.scheduler.busy() > 0 && Clock::now() < shutdown_end) {
    std::this_thread::sleep_for(std::chrono::milliseconds(10));
  }
  if (!parts.loader.idle() || parts.scheduler.busy() > 0) {
    // A scene that takes long to load and a task that is stuck can't be interrupted, and nothing is lost with
    // them: files appear in the data directory only when they are whole.
    spdlog::info("ending in the middle of {}", parts.loader.idle() ? "a task" : "loading a scene");
    std::_Exit(exit_code());
  }
  parts.metrics.reset();
  parts.sweeper.reset();
  parts.scheduler.close();
  parts.control.close();
  parts.loader.close();
  parts.files.close();
  parts.writer.close();
  for (Tenant* const tenant : tenants) tenant->close();
  parts_.reset();
}

}  // namespace fogbank::service
