#include "service/job.h"

#include <spdlog/spdlog.h>

#include <algorithm>
#include <utility>

#include "cache/scene_cache.h"
#include "cache/store/store.h"
#include "core/files.h"
#include "core/sha256.h"
#include "render/exr.h"
#include "service/job_progress.h"
#include "service/limits.h"
#include "service/messages.h"
#include "service/names.h"

namespace fogbank::service {

using grpc::StatusCode;

namespace {

std::string hash_of(const v1::CreateJobRequest& request) { return sha256(canonical_bytes(request)); }

}  // namespace

bool has_ended(v1::JobState state) {
  return state == v1::JOB_STATE_SUCCEEDED || state == v1::JOB_STATE_FAILED ||
         state == v1::JOB_STATE_CANCELLED;
}

Job::Job(const std::string& id, const v1::CreateJobRequest& request, JobSettings settings,
         std::filesystem::path folder, JobServices& services)
    : id_(id),
      request_id_(request.request_id()),
      request_hash_(hash_of(request)),
      scene_id_(parse_scene_name(request.scene())),
      folder_(std::move(folder)),
      services_(services),
      settings_(std::move(settings.effective)),
      engine_settings_(std::move(settings.engine)),
      board_(tile_count(settings_), seconds(settings_.update_interval_seconds())) {
  base_.set_name(job_name(id));
  base_.set_scene(request.scene());
  *base_.mutable_settings() = settings_;
  base_.set_state(v1::JOB_STATE_QUEUED);
  *base_.mutable_create_time() = timestamp_now();
  base_.mutable_progress()->set_tiles_total(static_cast<int32_t>(tile_count(settings_)));
  base_.set_request_id(request.request_id());
}

Job::Job(Restored, const v1::CreateJobRequest& request, v1::Job description, std::filesystem::path folder,
         JobServices& services)
    : id_(parse_job_name(description.name())),
      request_id_(request.request_id()),
      request_hash_(hash_of(request)),
      scene_id_(parse_scene_name(description.scene())),
      folder_(std::move(folder)),
      services_(services),
      settings_(description.settings()),
      base_(std::move(description)),
      board_(TileBoard::published(tile_count(settings_), base_.revision())) {}

std::shared_ptr<Job> Job::restore(std::filesystem::path folder, JobServices& services) {
  v1::CreateJobRequest request;
  v1::Job description;
  read_message(folder / "request.json", request);
  read_message(folder / "job.json", description);
  if (!has_ended(description.state())) {
    description.set_state(v1::JOB_STATE_FAILED);
    *description.mutable_end_time() = timestamp_now();
    *description.mutable_error() = to_status_message(
        {StatusCode::ABORTED, "SERVER_RESTARTED", "the server was stopped before the job had ended"});
    write_message(folder / "job.json", description);
  }
  return std::shared_ptr<Job>(
      new Job(Restored{}, request, std::move(description), std::move(folder), services));
}

int64_t Job::film_bytes() const {
  // Two half buffers, twice while one pass follows another (render/render_job.h).
  return int64_t{96} * settings_.crop().width() * settings_.crop().height();
}

void Job::save(const v1::CreateJobRequest& request) {
  std::filesystem::create_directories(folder_);
  write_message(folder_ / "request.json", request);
  write_message(folder_ / "job.json", describe());
}

bool Job::uses_cache() const { return service::uses_cache(settings_.integrator()); }

std::optional<uint64_t> Job::epoch() const {
  return settings_.has_epoch() ? std::optional<uint64_t>(settings_.epoch()) : std::nullopt;
}

void Job::start(std::shared_ptr<const transport::World> world, std::shared_ptr<cache::SceneCache> cache,
                double load_seconds) {
  std::string fingerprint = world->scene().fingerprint;
  std::string used_cache;
  if (cache) used_cache = cache_name(cache::record_field(world->scene(), max_depth()).transport);
  std::shared_ptr<render::RenderJob> render_job;
  try {
    engine_settings_.integrator_settings.cache = std::move(cache);
    render_job = std::make_shared<render::RenderJob>(std::move(world), engine_settings_);
  } catch (...) {
    fail(to_rpc_error(std::current_exception()));
    return;
  }
  const std::lock_guard lock(mutex_);
  if (stop_ || has_ended(base_.state())) return;
  render_job_ = std::move(render_job);
  scene_fingerprint_ = std::move(fingerprint);
  cache_name_ = std::move(used_cache);
  load_seconds_ += load_seconds;
  // Held for as long as tiles may be wanted; the film itself is shared with it.
  kept_tile_source_ = film_tiles(render_job_);
  tile_source_ = kept_tile_source_;
}

void Job::fail(const RpcError& error) {
  const std::lock_guard lock(mutex_);
  if (has_ended(base_.state()) || finishing_) return;
  if (!failure_) failure_ = error;
  stop_ = true;
  if (render_job_) render_job_->cancel();
  finish_if_idle();
}

void Job::cancel(const RpcError& why) {
  {
    const std::lock_guard lock(mutex_);
    if (!failure_ && !finishing_) failure_is_cancel_ = true;
  }
  fail(why);
}

std::function<void()> Job::take() {
  const std::lock_guard lock(mutex_);
  if (!render_job_ || stop_ || finishing_) return {};
  const std::optional<render::Task> task = render_job_->next_task();
  if (!task) {
    finish_if_idle();
    return {};
  }
  ++running_tasks_;
  if (base_.state() == v1::JOB_STATE_QUEUED) {
    base_.set_state(v1::JOB_STATE_RUNNING);
    *base_.mutable_start_time() = timestamp_now();
    board_.advance();
  }
  return [self = shared_from_this(), task = *task] { self->run(task); };
}

void Job::run(const render::Task& task) {
  const double cpu_before = thread_cpu_seconds();
  bool pass_completed = false;
  try {
    pass_completed = render_job_->run(task, stop_);
  } catch (...) {
    fail(to_rpc_error(std::current_exception()));
  }
  const double cpu = thread_cpu_seconds() - cpu_before;
  {
    const std::lock_guard lock(mutex_);
    --running_tasks_;
    render_cpu_seconds_ += cpu;
    if (!stop_) {
      const Clock::time_point now = Clock::now();
      ray_rate_.record(render_job_->progress().rays, now);
      ++tasks_completed_;
      if (const auto* const tile = std::get_if<render::TileTask>(&task)) {
        board_.complete(tile->tile, now);
        if (pass_completed) {
          unfinished_pass_.clear();
        } else {
          unfinished_pass_.push_back(tile->tile);
        }
      }
    }
    finish_if_idle();
  }
  services_.changed();
}

void Job::finish_if_idle() {
  if (finishing_ || running_tasks_ > 0) return;
  if (!stop_ && !(render_job_ && render_job_->ended())) return;
  finishing_ = true;
  const Clock::time_point now = Clock::now();
  // A job that ran out of time in the middle of a pass goes back to the pass before, in the tiles of that
  // pass.
  for (const uint32_t tile : unfinished_pass_) board_.complete(tile, now);
  board_.publish_all(now);
  // The server closes the writer only after all jobs have ended, so the task is always taken.
  services_.writer.post([self = shared_from_this()] { self->finish(); });
}

void Job::finish() {
  v1::Job description;
  std::optional<RpcError> failure;
  bool cancelled = false;
  {
    const std::lock_guard lock(mutex_);
    description = describe_locked();
    description.set_revision(board_.revision() + 1);
    failure = failure_;
    cancelled = failure_is_cancel_;
  }
  if (!failure) {
    try {
      store_image(description);
    } catch (...) {
      failure = to_rpc_error(std::current_exception());
      description.clear_result();
    }
  }
  description.mutable_progress()->clear_eta_seconds();
  description.mutable_progress()->set_rays_per_second(0);
  if (failure) {
    description.set_state(cancelled ? v1::JOB_STATE_CANCELLED : v1::JOB_STATE_FAILED);
    *description.mutable_error() = to_status_message(*failure);
    if (!cancelled) spdlog::warn("{} failed: {}", description.name(), failure->what());
  } else {
    description.set_state(v1::JOB_STATE_SUCCEEDED);
    description.mutable_progress()->set_fraction(1);
  }
  *description.mutable_end_time() = timestamp_now();
  end(std::move(description));
}

void Job::store_image(v1::Job& description) {
  // Records are on the disk before anybody hears that the job made them.
  if (const auto& cache = engine_settings_.integrator_settings.cache) cache->save();
  // Only this thread touches the film now; render_job_ stays until `end`.
  const render::Image image = render_job_->image();
  const render::Progress progress = render_job_->progress();
  const std::string file = render::encode_image(
      image, pixel_type(settings_), settings_.variance(),
      render::describe(engine_settings_, progress, render_job_->history(), scene_fingerprint_));
  write_file_durably(image_path(), file);

  v1::JobResult& result = *description.mutable_result();
  *result.mutable_window() = settings_.crop();
  result.set_film_width(image.full_width);
  result.set_film_height(image.full_height);
  result.set_samples_per_pixel(static_cast<int32_t>(image.samples));
  result.set_samples(progress.samples_done);
  result.set_rays(progress.rays);
  result.set_load_seconds(load_seconds_);
  result.set_render_seconds(progress.render_seconds);
  result.set_render_cpu_seconds(progress.cpu_seconds);
  if (progress.estimate.noise) result.set_relative_noise(*progress.estimate.noise);
  result.set_invalid_samples(progress.invalid_samples);
  result.set_image_bytes(static_cast<int64_t>(file.size()));
  result.set_image_sha256(sha256(file));
  result.set_cache(cache_name_);
  result.set_records_reused(progress.records_reused);
  result.set_records_new(progress.records_new);
  result.set_epoch(progress.epoch);
  for (const render::HistoryEntry& entry : render_job_->history()) *result.add_history() = to_message(entry);
}

void Job::end(v1::Job description) {
  // Durable before anybody hears of it. Should the disk refuse, the end itself is still told to those who
  // watch.
  try {
    write_message(folder_ / "job.json", description);
  } catch (const std::exception& error) {
    spdlog::error("{}: {}", description.name(), error.what());
  }
  std::shared_ptr<render::RenderJob> released;
  std::shared_ptr<const TileSource> released_source;
  {
    const std::lock_guard lock(mutex_);
    base_ = std::move(description);
    board_.advance();
    released = std::move(render_job_);
    render_job_ = nullptr;
    engine_settings_.integrator_settings.cache = nullptr;
    engine_settings_.reference = nullptr;
    if (watchers_ == 0) released_source = std::move(kept_tile_source_);
  }
  services_.ended(shared_from_this());
  services_.changed();
}

v1::JobState Job::state() const {
  const std::lock_guard lock(mutex_);
  return base_.state();
}

bool Job::ended() const { return has_ended(state()); }

double Job::rays_per_second() const {
  const std::lock_guard lock(mutex_);
  return base_.state() == v1::JOB_STATE_RUNNING ? ray_rate_.rate() : 0;
}

v1::Job Job::describe() const {
  const std::lock_guard lock(mutex_);
  return describe_locked();
}

v1::Job Job::describe_locked() const {
  v1::Job description = base_;
  description.set_revision(board_.revision());
  if (render_job_) *description.mutable_progress() = describe_progress();
  return description;
}

v1::Progress Job::describe_progress() const {
  v1::Progress message = to_message(render_job_->progress(), render_job_->history(), engine_settings_);
  message.set_tiles_total(static_cast<int32_t>(render_job_->tile_count()));
  message.set_rays_per_second(ray_rate_.rate());
  return message;
}

}  // namespace fogbank::service
