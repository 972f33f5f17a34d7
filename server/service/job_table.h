// All jobs: creation, admission to the scheduler, listing, the folder of jobs.
#pragma once

#include <cstdint>
#include <deque>
#include <exception>
#include <filesystem>
#include <functional>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <set>
#include <string>
#include <vector>

#include "service/cache_registry.h"
#include "service/film_budget.h"
#include "service/job.h"
#include "service/scene_registry.h"

namespace fogbank::service {

/// Jobs wait in the order of their creation until their films fit into the memory budget, and then share the
/// scheduler. Thread-safe. Everything here may wait for the disk: not for gRPC reactions.
class JobTable {
 public:
  struct Settings {
    std::filesystem::path folder;
    int group = 0;  ///< in the scheduler
    bool jobs_outlive_server =
        false;  ///< else they are cancelled with the server, and found dead after a crash
    TaskLimits task_limits;
    TraceLog* traces = nullptr;  ///< null: nothing is traced
  };

  /// Reads `folder`; what is damaged there is passed over with a log line. Throws as JobStore.
  JobTable(Settings settings, SceneRegistry& scenes, CacheRegistry& caches, BlobStore& blobs,
           TenantQuota& quota, Scheduler& scheduler, TaskQueue& writer, FilmBudget& films,
           std::function<void()> films_freed, std::function<void()> changed);

  /// Either the job or the error is set.
  using Created = std::function<void(std::shared_ptr<Job> job, std::exception_ptr error)>;
  /// Answers in this thread or in one of the scene loader. Throws, or answers with, RpcError
  /// INVALID_REQUEST_ID, INVALID_NAME, INVALID_SETTINGS, SCENE_NOT_FOUND, REQUEST_ID_REUSED, TOO_MANY_JOBS,
  /// QUOTA_EXCEEDED, BLOBS_MISSING, EPOCH_GONE, SHUTTING_DOWN, and what loading the scene ends with.
  /// `client` is the trace that the client belongs to.
  void create(const v1::CreateJobRequest& request, std::optional<TraceContext> client, Created done);

  /// Throws RpcError JOB_NOT_FOUND.
  std::shared_ptr<Job> find(const std::string& id) const;
  /// Throws RpcError INVALID_PAGE_SIZE, INVALID_PAGE_TOKEN.
  v1::ListJobsResponse list(const v1::ListJobsRequest& request) const;

  /// As Job::pause and Job::unpause.
  void pause(const std::shared_ptr<Job>& job);
  void unpause(const std::shared_ptr<Job>& job);
  /// Starts waiting jobs for which there is memory.
  void admit();
  /// Goes on with the jobs that an earlier life of the server has left, or cancels them.
  void resume();
  /// SHA-256 of the blobs that unfinished jobs need.
  std::set<std::string> blobs_in_use() const;

  /// Suspends or cancels all jobs and takes no new ones.
  void shut_down();
  /// Jobs that have not ended.
  size_t unfinished() const;

  struct Counts {
    int queued = 0;
    int running = 0;
    int succeeded = 0;
    int failed = 0;
    int cancelled = 0;
    int paused = 0;
    double rays_per_second = 0;
  };
  Counts counts() const;
  struct Totals {
    uint64_t rays = 0;
    uint64_t records_new = 0;
    uint64_t records_reused = 0;
  };
  /// Of all jobs that ended since the start and of those that run.
  Totals totals() const;
  uint64_t tiles() const { return services_.tiles; }
  uint64_t slow_tasks() const { return services_.slow_tasks; }
  int lost_threads() const { return services_.lost_threads; }
  /// As Job::watch_tasks, of all that are admitted.
  void watch_tasks() const;
  /// Memory of the films of the jobs that are admitted.
  int64_t film_bytes() const;
  /// Jobs that failed since the start, by reason.
  std::map<std::string, uint64_t> failures() const;

 private:
  struct Creation {
    std::string request_hash;
    std::vector<Created> waiting;
  };

  void restore();
  void remove_orphans() const;
  RpcError too_large(const Job& job) const;
  std::shared_ptr<Job> make_job(const v1::CreateJobRequest& request, std::optional<TraceContext> client,
                                const scene::Scene& scene);
  /// With the cache and the reference image that the job uses.
  render::RenderSettings engine_settings(const Job& job, const scene::Scene& scene);
  void finish_creation(const v1::CreateJobRequest& request, const std::optional<TraceContext>& client,
                       const std::shared_ptr<const transport::World>& world, double load_seconds,
                       std::exception_ptr error);
  void start(const std::shared_ptr<Job>& job);
  /// Its tasks can be taken.
  void schedule(const std::shared_ptr<Job>& job);
  /// In the scheduler's list while it is active, and not otherwise.
  void settle(const std::shared_ptr<Job>& job);
  /// Ended or suspended.
  void on_stopped(const std::shared_ptr<Job>& job);
  /// Suspends or cancels.
  void stop(Job& job) const;
  /// Forgets the oldest ended jobs above the limit.
  void forget_old();

  Settings settings_;
  SceneRegistry& scenes_;
  CacheRegistry& caches_;
  BlobStore& blobs_;
  TenantQuota& quota_;
  Scheduler& scheduler_;
  FilmBudget& films_;
  const std::function<void()> films_freed_;
  JobStore store_;
  JobServices services_;
  mutable std::mutex mutex_;
  std::map<std::string, std::shared_ptr<Job>> jobs_;  ///< by id, which sorts by age
  std::map<std::string, std::string> id_by_request_;  ///< request id -> job id
  std::map<std::string, Creation> creating_;          ///< by request id
  std::map<std::string, double> load_seconds_;        ///< what creation paid for loading, by job id
  std::deque<std::shared_ptr<Job>> waiting_;
  std::map<std::string, std::shared_ptr<Job>> active_;  ///< admitted and not ended
  int64_t active_film_bytes_ = 0;
  bool shut_down_ = false;
  Totals ended_;
  std::map<std::string, uint64_t> failures_;
};

}  // namespace fogbank::service
