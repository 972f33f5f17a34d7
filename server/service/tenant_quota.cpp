#include "service/tenant_quota.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "service/limits.h"
#include "service/rpc_error.h"

namespace fogbank::service {

namespace {

/// Parts of the window that it moves on by.
constexpr double window_parts = 120;

/// With the smallest whole numbers that say it.
std::string text_of(double value) { return std::to_string(static_cast<int64_t>(std::ceil(value))); }

RpcError exhausted(const QuotaUse& use, const std::string& what) {
  const std::string unit = use.unit == "count" ? "" : " " + use.unit;
  return RpcError(grpc::StatusCode::RESOURCE_EXHAUSTED, "QUOTA_EXCEEDED",
                  "the quota " + use.name + " is exhausted: " + text_of(use.used) + " of " +
                      text_of(use.limit) + unit + " are used" + what + "; retry in " +
                      text_of(use.retry_after_seconds) + " s",
                  {{"limit", use.name}, {"value", text_of(use.limit)}, {"used", text_of(use.used)}})
      .retry_after(use.retry_after_seconds);
}

QuotaUse count_use(const char* name, int64_t limit, size_t used) {
  QuotaUse use{
      .name = name, .unit = "count", .limit = static_cast<double>(limit), .used = static_cast<double>(used)};
  if (use.used >= use.limit) use.retry_after_seconds = limits::quota_retry_seconds;
  return use;
}

/// With `more` bytes to come.
QuotaUse byte_use(const char* name, int64_t limit, int64_t used, int64_t more) {
  QuotaUse use{
      .name = name, .unit = "bytes", .limit = static_cast<double>(limit), .used = static_cast<double>(used)};
  if (used + more > limit) use.retry_after_seconds = limits::sweep_seconds;
  return use;
}

void require_bytes(const QuotaUse& use, int64_t more) {
  if (use.retry_after_seconds == 0) return;
  throw exhausted(use, more == 0 ? "" : ", and " + std::to_string(more) + " more are wanted");
}

}  // namespace

TenantQuota::TenantQuota(std::string tenant, int group, const std::filesystem::path& folder, QuotaFile& file,
                         Scheduler& scheduler)
    : tenant_(std::move(tenant)),
      group_(group),
      file_(file),
      scheduler_(scheduler),
      stored_({folder / "blobs", folder / "scenes", folder / "jobs"}),
      caches_({folder / "caches"}),
      samples_{{.time = Clock::now(), .cpu_seconds = scheduler.cpu_seconds(group)}} {}

void TenantQuota::require_job(size_t unfinished) const {
  const Quota limit = quota();
  if (!limit.jobs) return;
  const QuotaUse use = count_use("jobs", *limit.jobs, unfinished);
  if (use.retry_after_seconds > 0) throw exhausted(use, " by unfinished jobs");
}

void TenantQuota::require_watcher(size_t open) const {
  const Quota limit = quota();
  if (!limit.watchers) return;
  const QuotaUse use = count_use("watchers", *limit.watchers, open);
  if (use.retry_after_seconds > 0) throw exhausted(use, " by open streams");
}

void TenantQuota::require_cpu() {
  const Quota limit = quota();
  if (!limit.cpu_seconds) return;
  const QuotaUse use = cpu_use(limit);
  if (use.retry_after_seconds > 0)
    throw exhausted(use, " in the last " + text_of(limit.window_seconds) + " s");
}

void TenantQuota::require_stored(int64_t bytes) {
  const Quota limit = quota();
  if (limit.stored_bytes)
    require_bytes(byte_use("stored_bytes", *limit.stored_bytes, stored_.used(), bytes), bytes);
}

DiskMeter::Reservation TenantQuota::reserve_stored(int64_t bytes) {
  require_stored(bytes);
  return {stored_, bytes};
}

void TenantQuota::require_cache(int64_t bytes) {
  const Quota limit = quota();
  if (limit.cache_bytes)
    require_bytes(byte_use("cache_bytes", *limit.cache_bytes, caches_.used(), bytes), bytes);
}

std::optional<int64_t> TenantQuota::cache_bytes() const { return quota().cache_bytes; }

QuotaUse TenantQuota::cpu_use(const Quota& quota) {
  const double total = scheduler_.cpu_seconds(group_);
  const Clock::time_point now = Clock::now();
  const std::lock_guard lock(mutex_);
  const Clock::time_point begin = now - seconds(quota.window_seconds);
  double before = samples_.front().cpu_seconds;
  for (const Sample& sample : samples_) {
    if (sample.time > begin) break;
    before = sample.cpu_seconds;
  }
  QuotaUse use{.name = "cpu_seconds",
               .unit = "seconds",
               .limit = *quota.cpu_seconds,
               .used = total - before,
               .window_seconds = quota.window_seconds};
  if (use.used < use.limit) return use;
  // When so much of it has left the window that there is some again.
  const auto leaves = std::ranges::find_if(
      samples_, [&](const Sample& sample) { return total - sample.cpu_seconds < use.limit; });
  use.retry_after_seconds =
      std::max(1.0, to_seconds((leaves == samples_.end() ? now : leaves->time) - begin));
  return use;
}

void TenantQuota::tick() {
  const Quota limit = quota();
  scheduler_.hold(group_, limit.cpu_seconds && cpu_use(limit).retry_after_seconds > 0);
  const Clock::time_point now = Clock::now();
  const Sample sample{.time = now, .cpu_seconds = scheduler_.cpu_seconds(group_)};
  const std::lock_guard lock(mutex_);
  if (now - samples_.back().time >= seconds(limit.window_seconds / window_parts)) samples_.push_back(sample);
  while (samples_.size() > 1 && samples_[1].time <= now - seconds(limit.window_seconds)) samples_.pop_front();
}

std::vector<QuotaUse> TenantQuota::uses(size_t unfinished_jobs, size_t watchers) {
  const Quota limit = quota();
  std::vector<QuotaUse> uses;
  if (limit.jobs) uses.push_back(count_use("jobs", *limit.jobs, unfinished_jobs));
  if (limit.stored_bytes) uses.push_back(byte_use("stored_bytes", *limit.stored_bytes, stored_.used(), 1));
  if (limit.cache_bytes) uses.push_back(byte_use("cache_bytes", *limit.cache_bytes, caches_.used(), 1));
  if (limit.watchers) uses.push_back(count_use("watchers", *limit.watchers, watchers));
  if (limit.cpu_seconds) uses.push_back(cpu_use(limit));
  return uses;
}

}  // namespace fogbank::service
