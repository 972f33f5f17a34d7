// The points of one Probe stream, as the scheduler sees them.
#pragma once

#include <functional>
#include <memory>
#include <mutex>
#include <vector>

#include "render/probe_job.h"
#include "service/scheduling/scheduler.h"

namespace fogbank::service {

/// Stands in the scheduler's list only while it has work: one that waited there for its client would be owed
/// the time that others had meanwhile. Thread-safe.
class ProbeWorkload : public Workload, public std::enable_shared_from_this<ProbeWorkload> {
 public:
  /// `changed`, called by render threads without any lock held: the job has results, or failed.
  ProbeWorkload(Scheduler& scheduler, int group, std::unique_ptr<render::ProbeJob> job,
                std::function<void()> changed)
      : scheduler_(scheduler), group_(group), job_(std::move(job)), changed_(std::move(changed)) {}

  render::ProbeJob& job() { return *job_; }
  const render::ProbeJob& job() const { return *job_; }
  void add(std::vector<Vec3f> points);
  void cancel();

  // Workload
  std::function<void()> take() override;
  int group() const override { return group_; }

 private:
  void run();
  /// Enters or leaves the scheduler's list. After everything that may bring or end work.
  void update();

  Scheduler& scheduler_;
  const int group_;
  const std::unique_ptr<render::ProbeJob> job_;
  const std::function<void()> changed_;
  std::mutex mutex_;  ///< never held by `take`, which runs with the scheduler's lock held
  bool scheduled_ = false;
};

}  // namespace fogbank::service
