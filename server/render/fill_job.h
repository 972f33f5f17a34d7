// Filling the cache for cameras, without a picture, as a set of tasks. The caller owns the threads, as with
// render_job.h. The records are a function of scene, settings, cameras and what the cache held.
#pragma once

#include <atomic>
#include <chrono>
#include <cstdint>
#include <exception>
#include <memory>
#include <mutex>
#include <optional>
#include <vector>

#include "integrators/integrator.h"
#include "render/film_camera.h"
#include "render/render_settings.h"
#include "transport/world.h"

namespace fogbank::render {

struct FillProgress {
  uint32_t cameras_done = 0;
  uint32_t camera_count = 0;
  double fraction = 0;          ///< of the work, about; 0 to 1
  uint64_t records_reused = 0;  ///< in the cache when the job began
  uint64_t records_new = 0;
  uint64_t epoch = 0;
  uint64_t rays = 0;
  double seconds = 0;  ///< wall, since the first task began; stands still when the job has ended
  bool ended = false;  ///< done, out of time, cancelled or failed
};

/// Thread-safe.
class FillJob {
 public:
  /// Makes what passes with `settings` from each of `cameras` need, one camera after the other, as jobs of
  /// their own would; within settings.time_budget_seconds and settings.integrator_settings.most_records
  /// altogether. Throws as `validate` and `make_integrator`.
  FillJob(std::shared_ptr<const transport::World> world, RenderSettings settings,
          std::vector<scene::Sensor> cameras);

  /// Is there work that no thread has taken, as of now?
  bool has_work() const;
  /// Does one task, if there is one; what it throws is kept: see `failure`. Leaves the thread prepared for
  /// rendering.
  void work();
  /// Running tasks stop soon, no other one is begun. Records made so far stay.
  void cancel();
  /// What a task threw, if one did; the job has ended then.
  std::exception_ptr failure() const;
  FillProgress progress() const;

 private:
  using Clock = std::chrono::steady_clock;

  /// One camera with its integrator: fresh for each, so that nothing but the cache is carried over.
  struct Part {
    FilmCamera camera;
    std::unique_ptr<integrators::Integrator> integrator;
    std::unique_ptr<integrators::Preparation> preparation;
  };

  /// These with `mutex_` held.
  bool has_work_locked() const;
  bool out_of_time() const;
  void end();

  /// Plans the next round, of the next camera where the present one is done.
  void plan();
  std::unique_ptr<Part> begin_part(uint32_t camera) const;

  const std::shared_ptr<const transport::World> world_;
  const RenderSettings settings_;
  const std::vector<scene::Sensor> cameras_;
  std::atomic<bool> stop_ = false;

  mutable std::mutex mutex_;
  std::unique_ptr<Part> part_;  ///< never changes while tasks run
  uint32_t round_tasks_ = 0;
  uint32_t next_task_ = 0;
  uint32_t running_ = 0;
  bool planning_ = false;
  std::exception_ptr failure_;
  FillProgress progress_;        ///< as of the last planning; `rays` and `ended` as they are
  uint64_t records_before_ = 0;  ///< made for the cameras that are done
  std::optional<Clock::time_point> start_;
  Clock::time_point end_{};
};

}  // namespace fogbank::render
