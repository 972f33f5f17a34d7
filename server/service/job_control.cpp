// The part of Job that others end, hold and interrupt it with, and that brings it into the next life of the
// server.
#include <spdlog/spdlog.h>

#include <algorithm>

#include "cache/scene_cache.h"
#include "core/error.h"
#include "core/failpoint.h"
#include "core/sha256.h"
#include "service/build_id.h"
#include "service/job.h"
#include "service/limits.h"
#include "service/messages.h"

namespace fogbank::service {

namespace {

// What the first checkpoint of a job is expected to take, before one was timed: two syncs and a slow disk.
constexpr double expected_sync_seconds = 0.02;
constexpr double expected_bytes_per_second = 2e8;
constexpr double film_bytes_per_pixel = 48;  // and layer

/// A checkpoint that names records is of no use without them.
void save_records(cache::SceneCache& records) {
  records.save();
  if (const std::string problem = records.storage().problem; !problem.empty())
    throw Error(ErrorKind::internal, "RECORDS_NOT_SAVED", problem);
}

}  // namespace

void Job::fail(const RpcError& error) {
  const std::lock_guard lock(mutex_);
  if (has_ended(base_.state()) || finishing_ || suspended_) return;
  if (!failure_) failure_ = error;
  stop_ = true;
  interrupt_ = true;
  if (render_job_) render_job_->cancel();
  finish_if_idle();
}

void Job::change_and_store(const std::function<bool()>& change) {
  const std::lock_guard one_at_a_time(store_mutex_);
  {
    const std::lock_guard lock(mutex_);
    if (has_ended(base_.state()) || finishing_) return;
    if (suspended_) throw shutting_down();
    if (!change()) return;
  }
  FOGBANK_FAILPOINT("job.before_change");
  services_.store.put({stored()});
  FOGBANK_FAILPOINT("job.after_change");
}

void Job::abandon(const RpcError& why) {
  {
    const std::lock_guard lock(mutex_);
    if (!failure_ && !finishing_) failure_is_cancel_ = true;
  }
  fail(why);
}

void Job::cancel(const RpcError& why) {
  change_and_store([&] {
    if (base_.has_error() || stop_) return false;
    *base_.mutable_error() = to_status_message(why);  // what the next life of the server would go by
    return true;
  });
  abandon(why);
}

void Job::pause() {
  change_and_store([&] {
    if (stop_ || paused_) return false;
    paused_ = true;
    interrupt_ = true;
    base_.set_state(v1::JOB_STATE_PAUSED);
    board_.advance();
    ++tasks_completed_;  // a change that progress tells of
    return true;
  });
  services_.changed();
}

void Job::unpause() {
  change_and_store([&] {
    if (stop_ || !paused_) return false;
    paused_ = false;
    interrupt_ = false;
    base_.set_state(base_.has_start_time() ? v1::JOB_STATE_RUNNING : v1::JOB_STATE_QUEUED);
    board_.advance();
    ++tasks_completed_;  // a change that progress tells of
    return true;
  });
  services_.changed();
}

void Job::suspend() {
  {
    const std::lock_guard lock(mutex_);
    if (has_ended(base_.state()) || finishing_ || stop_) return;
    suspended_ = true;
    interrupt_ = true;
    finish_if_idle();
  }
  services_.changed();
}

void Job::finish_suspension() {
  FOGBANK_FAILPOINT("job.before_suspension");
  write_checkpoint();
  {
    const std::lock_guard lock(mutex_);
    trace_.finish({{"fogbank.state", "SUSPENDED"}}, false);
  }
  services_.suspended(shared_from_this());
  services_.changed();
}

std::string Job::checkpoint_identity() const {
  return sha256(scene_fingerprint_ + build_id() + canonical_bytes(settings_));
}

bool Job::keeps_checkpoints() const { return !fill_only() && !(uses_cache() && epoch()); }

std::optional<render::Checkpoint> Job::read_checkpoint() const {
  std::error_code ignored;
  if (!std::filesystem::exists(checkpoint_path(), ignored)) return std::nullopt;
  try {
    return render::read_checkpoint(checkpoint_path(), checkpoint_identity());
  } catch (const Error& error) {
    spdlog::warn("{} begins again: {}", base_.name(), error.what());
    return std::nullopt;
  }
}

std::shared_ptr<render::RenderJob> Job::make_render_job(const std::shared_ptr<const transport::World>& world,
                                                        const render::RenderSettings& engine) {
  const auto performers = leased() ? render::Performers::replicas : render::Performers::caller;
  const std::shared_ptr<cache::SceneCache>& records = engine.integrator_settings.cache;
  const std::optional<render::Checkpoint> checkpoint = keeps_checkpoints() ? read_checkpoint() : std::nullopt;
  if (checkpoint) {
    try {
      render::RenderSettings as_then = engine;
      if (records) {
        if (!checkpoint->stage)
          throw Error(ErrorKind::data_loss, "CHECKPOINT_DAMAGED", "it names no records");
        as_then.integrator_settings.cache = cache::SceneCache::fork(records, checkpoint->stage->records);
        if (!as_then.integrator_settings.cache)
          throw Error(ErrorKind::data_loss, "RECORDS_GONE", "records that it needs are gone");
      }
      auto job = std::make_shared<render::RenderJob>(world, as_then, performers);
      if (checkpoint->passes > 0) job->resume(*checkpoint);
      spdlog::info("{} goes on after {} passes{}", base_.name(), checkpoint->passes,
                   records ? " with the records that it had" : "");
      return job;
    } catch (const Error& error) {
      spdlog::warn("{} begins again: {}", base_.name(), error.what());
    }
  }
  if (records && keeps_checkpoints()) write_first_checkpoint(*records);
  return std::make_shared<render::RenderJob>(world, engine, performers);
}

void Job::write_first_checkpoint(cache::SceneCache& records) {
  const Clock::time_point start = Clock::now();
  try {
    save_records(records);
    auto stage = std::make_shared<render::CachedStage>();
    const std::shared_ptr<const cache::RecordSet> set = records.records();
    stage->records.assign(set->ids().begin(), set->ids().end());
    render::Checkpoint beginning;
    beginning.stage = std::move(stage);
    render::write_checkpoint(checkpoint_path(), beginning, checkpoint_identity());
  } catch (const std::exception& error) {
    spdlog::warn("{}: no checkpoint: {}", base_.name(), error.what());
  }
  const std::lock_guard lock(mutex_);
  checkpoint_seconds_ += to_seconds(Clock::now() - start);
}

void Job::checkpoint_if_due() {
  if (!keeps_checkpoints() || checkpoint_pending_ || render_job_->ended()) return;
  const double pixels = static_cast<double>(settings_.crop().width()) * settings_.crop().height();
  const double bytes = (uses_cache() ? 2 : 1) * film_bytes_per_pixel * pixels;
  const double expected =
      std::max(expected_sync_seconds + bytes / expected_bytes_per_second, last_checkpoint_seconds_);
  if (checkpoint_seconds_ + expected > limits::checkpoint_share * render_cpu_seconds_) return;
  checkpoint_pending_ = true;
  services_.writer.post([self = shared_from_this()] { self->write_checkpoint(); });
}

void Job::write_checkpoint() {
  std::shared_ptr<render::RenderJob> job;
  std::shared_ptr<cache::SceneCache> records;
  uint32_t passes_before = 0;
  {
    const std::lock_guard lock(mutex_);
    job = render_job_;
    records = engine_settings_.integrator_settings.cache;
    passes_before = checkpoint_passes_;
  }
  const Clock::time_point start = Clock::now();
  uint32_t passes = passes_before;
  try {
    const auto checkpoint = job && keeps_checkpoints() ? job->checkpoint() : std::nullopt;
    if (checkpoint && checkpoint->passes > passes_before) {
      // What rests on records that the disk doesn't have is not to be continued.
      if (records) save_records(*records);
      render::write_checkpoint(checkpoint_path(), *checkpoint, checkpoint_identity());
      passes = checkpoint->passes;
    }
  } catch (const std::exception& error) {
    spdlog::warn("{}: no checkpoint: {}", base_.name(), error.what());
  }
  const std::lock_guard lock(mutex_);
  checkpoint_pending_ = false;
  checkpoint_passes_ = passes;
  last_checkpoint_seconds_ = to_seconds(Clock::now() - start);
  checkpoint_seconds_ += last_checkpoint_seconds_;
}

}  // namespace fogbank::service
