#include "service/metrics.h"

#include <prometheus/collectable.h>
#include <prometheus/exposer.h>
#include <prometheus/metric_family.h>

#include <chrono>
#include <utility>
#include <vector>

#include "service/resident_memory.h"
#include "service/server.h"

namespace fogbank::service {

namespace {

using Labels = std::vector<prometheus::ClientMetric::Label>;

/// The values of one name.
class Family {
 public:
  Family(std::string name, std::string help, prometheus::MetricType type) {
    family_.name = std::move(name);
    family_.help = std::move(help);
    family_.type = type;
  }

  void add(double value, Labels labels) {
    prometheus::ClientMetric metric;
    metric.label = std::move(labels);
    if (family_.type == prometheus::MetricType::Counter) {
      metric.counter.value = value;
    } else {
      metric.gauge.value = value;
    }
    family_.metric.push_back(std::move(metric));
  }
  const prometheus::MetricFamily& family() const { return family_; }

 private:
  prometheus::MetricFamily family_;
};

Family gauge(std::string name, std::string help) {
  return {std::move(name), std::move(help), prometheus::MetricType::Gauge};
}

Family counter(std::string name, std::string help) {
  return {std::move(name), std::move(help), prometheus::MetricType::Counter};
}

class Collector final : public prometheus::Collectable {
 public:
  Collector(const Tenants& tenants, const Scheduler& scheduler, const ReaderHost& readers,
            std::filesystem::path data)
      : tenants_(tenants), scheduler_(scheduler), readers_(readers), data_(std::move(data)) {}

  std::vector<prometheus::MetricFamily> Collect() const override {
    Family jobs = gauge("fogbank_jobs", "Jobs that are kept, by state");
    Family failures = counter("fogbank_job_failures_total", "Jobs that failed since the start, by reason");
    Family rays = counter("fogbank_rays_total", "Rays of jobs since the start");
    Family tiles =
        counter("fogbank_tiles_total", "Tiles rendered since the start, those of every pass counted");
    Family slow = counter("fogbank_slow_tasks_total",
                          "Tiles and other tasks that ran longer than the watchdog's bound");
    Family lost = gauge("fogbank_lost_threads", "Render threads in tasks that their jobs gave up");
    Family records = counter("fogbank_cache_records_total", "Records of caches that jobs have made or found");
    Family rate = gauge("fogbank_rays_per_second", "Rays per second of the last seconds");
    Family streams = gauge("fogbank_streams", "Open streams, by kind");
    Family scenes = gauge("fogbank_scenes", "Scenes that are known or in memory");
    Family memory = gauge("fogbank_memory_bytes", "Memory of scenes, caches and films");
    Family quotas = gauge("fogbank_quota_limit", "Most that a tenant may use, by quota");
    Family quota_uses = gauge("fogbank_quota_used", "What a tenant uses of its quotas");
    for (Tenant* const tenant : tenants_.all()) {
      const auto of = [&](const char* name, std::string value) {
        return Labels{{"tenant", tenant->name}, {name, std::move(value)}};
      };
      const Labels whole = {{"tenant", tenant->name}};
      const JobTable::Counts counts = tenant->jobs.counts();
      jobs.add(counts.queued, of("state", "queued"));
      jobs.add(counts.running, of("state", "running"));
      jobs.add(counts.paused, of("state", "paused"));
      jobs.add(counts.succeeded, of("state", "succeeded"));
      jobs.add(counts.failed, of("state", "failed"));
      jobs.add(counts.cancelled, of("state", "cancelled"));
      for (const auto& [reason, count] : tenant->jobs.failures())
        failures.add(static_cast<double>(count), of("reason", reason));
      const JobTable::Totals totals = tenant->jobs.totals();
      rays.add(static_cast<double>(totals.rays), whole);
      tiles.add(static_cast<double>(tenant->jobs.tiles()), whole);
      slow.add(static_cast<double>(tenant->jobs.slow_tasks()), whole);
      lost.add(tenant->jobs.lost_threads(), whole);
      records.add(static_cast<double>(totals.records_new), of("kind", "new"));
      records.add(static_cast<double>(totals.records_reused), of("kind", "reused"));
      rate.add(counts.rays_per_second, whole);
      streams.add(static_cast<double>(tenant->pump.streams()), of("kind", "watch"));
      streams.add(static_cast<double>(tenant->probe_pump.streams()), of("kind", "probe"));
      streams.add(static_cast<double>(tenant->fill_pump.streams()), of("kind", "fill"));
      for (const QuotaUse& use : tenant->quota_uses()) {
        quotas.add(use.limit, of("quota", use.name));
        quota_uses.add(use.used, of("quota", use.name));
      }
      const SceneRegistry::Counts known = tenant->scenes.counts();
      scenes.add(known.scenes, of("state", "known"));
      scenes.add(known.resident, of("state", "resident"));
      memory.add(static_cast<double>(known.resident_bytes), of("kind", "scenes"));
      memory.add(static_cast<double>(tenant->caches.memory_bytes()), of("kind", "caches"));
      memory.add(static_cast<double>(tenant->jobs.film_bytes()), of("kind", "films"));
    }
    Family threads = gauge("fogbank_render_threads", "Render threads");
    const int busy = scheduler_.busy();
    threads.add(busy, {{"state", "busy"}});
    threads.add(scheduler_.threads() - busy, {{"state", "idle"}});
    Family resident = gauge("process_resident_memory_bytes", "Resident memory of the process");
    resident.add(static_cast<double>(resident_memory_bytes()), {});
    Family start = gauge("process_start_time_seconds", "When the server was started, seconds since 1970");
    start.add(start_seconds_, {});
    Family disk = gauge("fogbank_disk_free_bytes", "Space left on the disk of the data directory");
    std::error_code unknown;
    const std::filesystem::space_info space = std::filesystem::space(data_, unknown);
    if (!unknown) disk.add(static_cast<double>(space.available), {});
    Family confinement =
        gauge("fogbank_reader_confinement",
              "1: the layer confines the processes that read scene files; 0: it can't be had");
    if (const auto known = readers_.confinement())
      for (const ConfinementLayer& layer : layers_of(*known))
        confinement.add(layer.problem.empty() ? 1 : 0, {{"layer", layer.name}});
    std::vector<prometheus::MetricFamily> families;
    for (const Family* const family :
         {&jobs, &failures, &rays, &tiles, &records, &rate, &streams, &scenes, &memory, &quotas, &quota_uses,
          &slow, &lost, &threads, &resident, &start, &disk, &confinement}) {
      families.push_back(family->family());
    }
    return families;
  }

 private:
  const Tenants& tenants_;
  const Scheduler& scheduler_;
  const ReaderHost& readers_;
  const std::filesystem::path data_;
  const double start_seconds_ =
      std::chrono::duration<double>(std::chrono::system_clock::now().time_since_epoch()).count();
};

}  // namespace

struct MetricsEndpoint::Parts {
  std::unique_ptr<prometheus::Exposer> exposer;
  std::shared_ptr<Collector> collector;
};

MetricsEndpoint::MetricsEndpoint(const std::string& address, const Tenants& tenants,
                                 const Scheduler& scheduler, const ReaderHost& readers,
                                 std::filesystem::path data)
    : parts_(std::make_unique<Parts>()) {
  try {
    parts_->exposer = std::make_unique<prometheus::Exposer>(address, 1);
  } catch (const std::exception&) {
    throw OptionError("can't serve metrics on " + address + ": is the address in use?");
  }
  parts_->collector = std::make_shared<Collector>(tenants, scheduler, readers, std::move(data));
  parts_->exposer->RegisterCollectable(parts_->collector);
}

MetricsEndpoint::~MetricsEndpoint() = default;

}  // namespace fogbank::service
