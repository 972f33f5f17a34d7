// The rounds of one FillCache stream, as the scheduler sees them.
#pragma once

#include <functional>
#include <memory>
#include <mutex>

#include "render/fill_job.h"
#include "service/scheduling/scheduler.h"

namespace fogbank::service {

/// In the scheduler's list from `start` to the job's end. Thread-safe.
class FillWorkload : public Workload, public std::enable_shared_from_this<FillWorkload> {
 public:
  /// `ended`, called once by a render thread without any lock held: the job has ended.
  FillWorkload(Scheduler& scheduler, int group, std::unique_ptr<render::FillJob> job,
               std::function<void()> ended)
      : scheduler_(scheduler), group_(group), job_(std::move(job)), ended_(std::move(ended)) {}

  const render::FillJob& job() const { return *job_; }
  void start();
  void cancel();

  // Workload
  std::function<void()> take() override;
  int group() const override { return group_; }

 private:
  void run();

  Scheduler& scheduler_;
  const int group_;
  const std::unique_ptr<render::FillJob> job_;
  const std::function<void()> ended_;
  std::once_flag end_told_;
};

}  // namespace fogbank::service
