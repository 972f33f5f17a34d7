#include "render/fill_job.h"

#include <algorithm>
#include <utility>

#include "render/job_integrator.h"
#include "render/progression.h"
#include "scene/intersector.h"

namespace fogbank::render {

FillJob::FillJob(std::shared_ptr<const transport::World> world, RenderSettings settings,
                 std::vector<scene::Sensor> cameras)
    : world_(std::move(world)), settings_(std::move(settings)), cameras_(std::move(cameras)) {
  RenderSettings checked = settings_;
  for (const scene::Sensor& camera : cameras_) {
    checked.sensor = camera;
    validate(checked);
  }
  progress_.camera_count = static_cast<uint32_t>(cameras_.size());
  if (cameras_.empty()) {
    progress_.ended = true;
    return;
  }
  part_ = begin_part(0);
  const integrators::CacheCounts counts = part_->integrator->cache_counts();
  progress_.records_reused = counts.records_reused;
  progress_.epoch = counts.epoch;
}

std::unique_ptr<FillJob::Part> FillJob::begin_part(uint32_t camera) const {
  integrators::IntegratorSettings settings = integrator_settings(settings_);
  settings.most_records -= static_cast<int64_t>(records_before_);
  settings.camera_medium = camera_medium(*world_, cameras_[camera]);
  auto part = std::make_unique<Part>(
      Part{.camera = FilmCamera(cameras_[camera], settings_.film),
           .integrator = integrators::make_integrator(settings_.integrator, world_, settings),
           .preparation = nullptr});
  part->preparation = part->integrator->prepare(part->camera, {.error = cache_error(settings_)});
  return part;
}

bool FillJob::has_work_locked() const {
  if (progress_.ended || planning_) return false;
  return next_task_ < round_tasks_ || running_ == 0;
}

bool FillJob::has_work() const {
  const std::lock_guard lock(mutex_);
  return has_work_locked();
}

bool FillJob::out_of_time() const {
  return settings_.time_budget_seconds > 0 && start_ &&
         std::chrono::duration<double>(Clock::now() - *start_).count() >= settings_.time_budget_seconds;
}

void FillJob::end() {
  if (progress_.ended) return;
  progress_.ended = true;
  stop_ = true;
  end_ = Clock::now();
}

void FillJob::work() {
  scene::prepare_render_thread();
  RayCounters counters;
  counters.stop = &stop_;
  std::optional<uint32_t> task;
  {
    const std::lock_guard lock(mutex_);
    if (!has_work_locked()) return;
    if (!start_) start_ = Clock::now();
    if (next_task_ < round_tasks_) {
      task = next_task_++;
      ++running_;
    } else {
      planning_ = true;
    }
  }
  std::exception_ptr failure;
  try {
    if (task) {
      part_->preparation->run(*task, counters);
    } else {
      plan();
    }
  } catch (const Interrupted&) {
    // The job has ended: nobody waits for the task.
  } catch (...) {
    failure = std::current_exception();
  }
  const std::lock_guard lock(mutex_);
  if (task) {
    --running_;
  } else {
    planning_ = false;
  }
  progress_.rays += counters.total();
  if (failure && !progress_.ended) failure_ = failure;
  if (failure || out_of_time()) end();
}

void FillJob::plan() {
  // No task runs now; the lock is for those that ask for the progress.
  while (!stop_) {
    const uint32_t tasks = part_->preparation ? part_->preparation->next_round() : 0;
    const integrators::CacheCounts counts = part_->integrator->cache_counts();
    const uint64_t records_made = records_before_ + counts.records_new;
    std::unique_ptr<Part> next;
    const bool camera_done = tasks == 0;
    if (camera_done) {
      records_before_ = records_made;
      const uint32_t camera = progress_.cameras_done + 1;
      const bool may_make_more =
          static_cast<int64_t>(records_made) < settings_.integrator_settings.most_records;
      if (camera < progress_.camera_count && may_make_more) next = begin_part(camera);
    }
    const std::lock_guard lock(mutex_);
    progress_.records_new = records_made;
    progress_.epoch = counts.epoch;
    if (camera_done) {
      ++progress_.cameras_done;
      part_ = std::move(next);
      if (!part_) end();
    }
    const double present =
        part_ && part_->preparation ? std::clamp(part_->preparation->fraction(), 0.0, 1.0) : 0;
    progress_.fraction = std::min(1.0, (progress_.cameras_done + present) / progress_.camera_count);
    round_tasks_ = tasks;
    next_task_ = 0;
    if (!camera_done) return;
  }
}

void FillJob::cancel() {
  const std::lock_guard lock(mutex_);
  end();
}

std::exception_ptr FillJob::failure() const {
  const std::lock_guard lock(mutex_);
  return failure_;
}

FillProgress FillJob::progress() const {
  const std::lock_guard lock(mutex_);
  FillProgress progress = progress_;
  if (start_)
    progress.seconds =
        std::chrono::duration<double>((progress.ended ? end_ : Clock::now()) - *start_).count();
  return progress;
}

}  // namespace fogbank::render
