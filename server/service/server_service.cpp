#include "service/server_service.h"

#include <filesystem>
#include <vector>

#include "derivatives/estimator.h"
#include "integrators/integrator.h"
#include "service/answers.h"
#include "service/build_id.h"
#include "service/channel_arguments.h"
#include "service/limits.h"
#include "service/messages.h"
#include "service/resident_memory.h"
#include "transport/bsdf.h"
#include "transport/lights/light_registry.h"

namespace fogbank::service {

namespace {

void add_plugins(v1::GetCapabilitiesResponse& capabilities, const char* kind,
                 const std::vector<std::string>& names) {
  v1::ScenePlugins& plugins = *capabilities.add_scene_plugins();
  plugins.set_kind(kind);
  for (const std::string& name : names) plugins.add_names(name);
}

v1::GetCapabilitiesResponse describe_capabilities(bool scene_root) {
  v1::GetCapabilitiesResponse capabilities;
  capabilities.set_version(FOGBANK_VERSION);
  capabilities.set_build_id(build_id());
  for (const integrators::IntegratorInfo& info : integrators::supported_integrators()) {
    v1::Integrator& integrator = *capabilities.add_integrators();
    integrator.set_name(info.name);
    integrator.set_description(info.summary);
    integrator.set_cached(info.cached);
  }
  for (const derivatives::MethodInfo& info : derivatives::supported_methods()) {
    v1::ProbeMethod& method = *capabilities.add_probe_methods();
    method.set_name(info.name);
    method.set_description(info.summary);
  }
  for (const limits::Entry& entry : limits::table()) {
    v1::Limit& limit = *capabilities.add_limits();
    limit.set_name(entry.name);
    limit.set_value(entry.value);
    limit.set_unit(entry.unit);
    limit.set_description(entry.description);
  }
  add_plugins(capabilities, "bsdf", transport::supported_bsdfs());
  add_plugins(capabilities, "emitter", transport::supported_emitters());
  for (const ChannelArgument& argument : channel_arguments()) {
    if (!argument.client) continue;
    v1::ChannelArgument& message = *capabilities.add_channel_arguments();
    message.set_name(argument.name);
    message.set_value(argument.value);
    message.set_description(argument.description);
  }
  capabilities.set_scene_root(scene_root);
  return capabilities;
}

}  // namespace

ServerServiceImplementation::ServerServiceImplementation(Tenants& tenants, bool scene_root,
                                                         std::filesystem::path data, int64_t memory_bytes,
                                                         const Scheduler& scheduler,
                                                         const ReaderHost& readers, TaskQueue& control)
    : tenants_(tenants),
      data_(std::move(data)),
      memory_bytes_(memory_bytes),
      scheduler_(scheduler),
      readers_(readers),
      control_(control),
      start_time_(timestamp_now()),
      capabilities_(describe_capabilities(scene_root)) {}

grpc::ServerUnaryReactor* ServerServiceImplementation::GetCapabilities(
    grpc::CallbackServerContext* context, const v1::GetCapabilitiesRequest*,
    v1::GetCapabilitiesResponse* response) {
  return answer(context, control_, [this, context, response] {
    tenants_.enter(*context, "ServerService.GetCapabilities");
    *response = capabilities_;
  });
}

grpc::ServerUnaryReactor* ServerServiceImplementation::GetServerStatus(
    grpc::CallbackServerContext* context, const v1::GetServerStatusRequest*,
    v1::GetServerStatusResponse* response) {
  return answer(context, control_, [this, context, response] {
    Tenant& tenant = tenants_.enter(*context, "ServerService.GetServerStatus");
    *response->mutable_start_time() = start_time_;
    response->set_uptime_seconds(to_seconds(Clock::now() - start_));
    const JobTable::Counts jobs = tenant.jobs.counts();
    response->mutable_jobs()->set_queued(jobs.queued);
    response->mutable_jobs()->set_running(jobs.running);
    response->mutable_jobs()->set_succeeded(jobs.succeeded);
    response->mutable_jobs()->set_failed(jobs.failed);
    response->mutable_jobs()->set_cancelled(jobs.cancelled);
    response->mutable_jobs()->set_paused(jobs.paused);
    const SceneRegistry::Counts scenes = tenant.scenes.counts();
    response->set_scenes(scenes.scenes);
    response->set_resident_scenes(scenes.resident);
    response->set_scene_memory_bytes(scenes.resident_bytes);
    response->set_worker_threads(scheduler_.threads());
    response->set_busy_threads(scheduler_.busy());
    response->set_memory_bytes(resident_memory_bytes());
    response->set_rays_per_second(jobs.rays_per_second);
    response->set_watchers(static_cast<int32_t>(tenant.pump.streams()));
    response->set_probes(static_cast<int32_t>(tenant.probe_pump.streams()));
    response->set_rays(tenant.jobs.totals().rays);
    response->set_cache_memory_bytes(tenant.caches.memory_bytes());
    response->set_fills(static_cast<int32_t>(tenant.fill_pump.streams()));
    response->set_tiles(tenant.jobs.tiles());
    response->set_film_memory_bytes(tenant.jobs.film_bytes());
    for (const auto& [reason, count] : tenant.jobs.failures()) {
      v1::ErrorCount& error = *response->add_errors();
      error.set_reason(reason);
      error.set_count(count);
    }
    response->set_memory_budget_bytes(memory_bytes_);
    std::error_code unknown;
    const std::filesystem::space_info space = std::filesystem::space(data_, unknown);
    if (!unknown) response->set_disk_free_bytes(static_cast<int64_t>(space.available));
    response->set_tenant(tenant.name);
    if (const auto confinement = readers_.confinement()) {
      for (const ConfinementLayer& layer : layers_of(*confinement)) {
        v1::ConfinementLayer& message = *response->add_reader_confinement();
        message.set_name(layer.name);
        message.set_in_force(layer.problem.empty());
        message.set_problem(layer.problem);
      }
    }
    for (const QuotaUse& use : tenant.quota_uses()) {
      v1::QuotaUse& message = *response->add_quotas();
      message.set_name(use.name);
      message.set_unit(use.unit);
      message.set_limit(use.limit);
      message.set_used(use.used);
      message.set_window_seconds(use.window_seconds);
      message.set_retry_after_seconds(use.retry_after_seconds);
    }
  });
}

}  // namespace fogbank::service
