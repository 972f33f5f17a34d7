// Holds what a tenant uses against its quota.
#pragma once

#include <cstddef>
#include <cstdint>
#include <deque>
#include <filesystem>
#include <mutex>
#include <string>
#include <vector>

#include "service/disk_meter.h"
#include "service/quota_file.h"
#include "service/scheduling/scheduler.h"

namespace fogbank::service {

/// One part of a quota, as it stands.
struct QuotaUse {
  std::string name;  ///< as in Quota
  std::string unit;  ///< "count", "bytes", "seconds"
  double limit = 0;
  double used = 0;
  double window_seconds = 0;       ///< of cpu_seconds; 0 for the others
  double retry_after_seconds = 0;  ///< 0 while it is not exhausted
};

/// The `require_` functions throw RpcError RESOURCE_EXHAUSTED (QUOTA_EXCEEDED) with the name of what is
/// exhausted as metadata `limit`, and when to ask again. A tenant that has had its CPU time starts nothing
/// new, and what it runs is held until the window has moved on. CPU time is counted from the server's start.
/// Thread-safe. Those that count bytes may wait for the disk: not for gRPC reactions.
class TenantQuota {
 public:
  /// `folder` is the tenant's, `group` its number in the scheduler.
  TenantQuota(std::string tenant, int group, const std::filesystem::path& folder, QuotaFile& file,
              Scheduler& scheduler);

  /// One more, with so many already.
  void require_job(size_t unfinished) const;
  void require_watcher(size_t open) const;
  void require_cpu();
  /// Room for so many bytes, which count as used for as long as they are reserved.
  DiskMeter::Reservation reserve_stored(int64_t bytes);
  void require_stored(int64_t bytes);
  /// Room for so many bytes of caches; 0: the caches are not above the quota.
  void require_cache(int64_t bytes);

  /// What caches are kept within; nothing: no quota.
  std::optional<int64_t> cache_bytes() const;
  /// Takes note of the CPU time used, and holds the tenant's tasks or lets them go; meant for once a second.
  void tick();
  /// The parts that the tenant has; may wait for the disk.
  std::vector<QuotaUse> uses(size_t unfinished_jobs, size_t watchers);

 private:
  struct Sample {
    Clock::time_point time;
    double cpu_seconds = 0;  ///< since the start
  };

  Quota quota() const { return file_.of(tenant_); }
  QuotaUse cpu_use(const Quota& quota);

  const std::string tenant_;
  const int group_;
  QuotaFile& file_;
  Scheduler& scheduler_;
  DiskMeter stored_;
  DiskMeter caches_;
  std::mutex mutex_;
  std::deque<Sample> samples_;  ///< oldest first: the last one before the window, and those in it
};

}  // namespace fogbank::service
