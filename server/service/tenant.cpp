#include "service/tenant.h"

#include <set>
#include <utility>

#include "service/limits.h"

namespace fogbank::service {

Tenant::Tenant(std::string name_to_use, int number_to_use, const std::filesystem::path& folder,
               const TenantSettings& settings, SharedServices& shared)
    : name(std::move(name_to_use)),
      number(number_to_use),
      quota(name, number, folder, shared.quotas, shared.scheduler),
      blobs(folder / "blobs", &quota),
      scenes({.folder = folder / "scenes", .scene_root = settings.scene_root}, blobs, shared.loader,
             shared.readers),
      caches({.folder = folder / "caches", .disk_budget_bytes = settings.cache_disk_bytes}),
      jobs({.folder = folder / "jobs",
            .group = number,
            .jobs_outlive_server = settings.jobs_outlive_server,
            .task_limits = settings.task_limits,
            .traces = shared.traces},
           scenes, caches, blobs, quota, shared.scheduler, shared.writer, shared.films, shared.films_freed,
           [this] { pump.news(); }),
      probes{.scenes = scenes,
             .scheduler = shared.scheduler,
             .control = shared.control,
             .pump = probe_pump,
             .quota = quota,
             .group = number,
             .traces = shared.traces},
      fills{.scenes = scenes,
            .caches = caches,
            .scheduler = shared.scheduler,
            .control = shared.control,
            .pump = fill_pump,
            .quota = quota,
            .group = number,
            .traces = shared.traces},
      replicas([this] { perform_pump.news(); }),
      performs{.scheduler = shared.scheduler, .pump = perform_pump, .group = number} {}

void Tenant::sweep() {
  std::set<std::string> in_use = scenes.blobs_in_use();
  in_use.merge(jobs.blobs_in_use());
  blobs.sweep(in_use, std::chrono::seconds(static_cast<int64_t>(limits::blob_lifetime_seconds)),
              std::chrono::seconds(static_cast<int64_t>(limits::partial_upload_lifetime_seconds)));
  caches.keep_within_budget(quota.cache_bytes());
  replicas.sweep();
}

std::vector<QuotaUse> Tenant::quota_uses() { return quota.uses(jobs.unfinished(), pump.streams()); }

void Tenant::shut_down() {
  scenes.shut_down();
  jobs.shut_down();
  probes.shutting_down = true;
  probe_pump.news();
  fills.shutting_down = true;
  fill_pump.news();
  performs.shutting_down = true;
  replicas.shut_down();
}

bool Tenant::idle() const {
  return jobs.unfinished() == 0 && pump.streams() == 0 && probe_pump.streams() == 0 &&
         fill_pump.streams() == 0 && perform_pump.streams() == 0;
}

void Tenant::close() {
  pump.close();
  probe_pump.close();
  fill_pump.close();
  perform_pump.close();
}

}  // namespace fogbank::service
