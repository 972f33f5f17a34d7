// All that one user of the server has: files, scenes, caches, jobs, streams.
#pragma once

#include <atomic>
#include <filesystem>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "service/blob_store.h"
#include "service/cache_registry.h"
#include "service/fill_stream.h"
#include "service/film_budget.h"
#include "service/job_table.h"
#include "service/perform_stream.h"
#include "service/probe_stream.h"
#include "service/replica_table.h"
#include "service/scene_registry.h"
#include "service/stream_pump.h"
#include "service/tenant_quota.h"

namespace fogbank::service {

/// What tenants share. They compete for nothing else: limits count for each of them.
struct SharedServices {
  TaskQueue& control;
  TaskQueue& writer;
  TaskQueue& loader;
  ReaderHost& readers;
  Scheduler& scheduler;
  FilmBudget& films;
  QuotaFile& quotas;
  TraceLog* traces;                   ///< null: nothing is traced
  std::function<void()> films_freed;  ///< waiting jobs, of whomever, may fit now
};

struct TenantSettings {
  std::optional<std::filesystem::path> scene_root;
  int64_t cache_disk_bytes = 0;  ///< 0: no limit
  bool jobs_outlive_server = true;
  TaskLimits task_limits;
};

/// Nothing of one tenant can be named by another: each has a folder and tables of its own, so that a name
/// means something else, or nothing, to everybody else. Members in the order of their dependence.
class Tenant {
 public:
  /// Reads `folder`. Throws as JobTable.
  Tenant(std::string name, int number, const std::filesystem::path& folder, const TenantSettings& settings,
         SharedServices& shared);

  /// Removes what nobody needs any more.
  void sweep();
  /// Takes nothing new, and ends what goes on.
  void shut_down();
  /// Nothing goes on any more.
  bool idle() const;
  /// Ends the threads that feed its streams.
  void close();

  /// How much of its quota is used; may wait for the disk.
  std::vector<QuotaUse> quota_uses();

  const std::string name;  ///< empty where nobody is asked who they are
  const int number;        ///< its group in the scheduler
  TenantQuota quota;
  StreamPump pump;
  StreamPump probe_pump;
  StreamPump fill_pump;
  StreamPump perform_pump;
  BlobStore blobs;
  SceneRegistry scenes;
  CacheRegistry caches;
  JobTable jobs;
  ProbeServices probes;
  FillServices fills;
  ReplicaTable replicas;
  PerformServices performs;
};

}  // namespace fogbank::service
