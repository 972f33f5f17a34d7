#include "service/job.h"

#include <spdlog/spdlog.h>

#include <algorithm>
#include <utility>

#include "cache/scene_cache.h"
#include "cache/store/store.h"
#include "core/failpoint.h"
#include "core/files.h"
#include "core/sha256.h"
#include "render/exr.h"
#include "service/job_progress.h"
#include "service/limits.h"
#include "service/messages.h"
#include "service/names.h"

namespace fogbank::service {

namespace {

std::string hash_of(const v1::CreateJobRequest& request) { return sha256(canonical_bytes(request)); }

v1::JobPriority known_priority(v1::JobPriority priority) {
  return priority == v1::JOB_PRIORITY_UNSPECIFIED ? v1::JOB_PRIORITY_NORMAL : priority;
}

/// More than a job publishes in one life of the server.
uint64_t first_revision(int32_t restarts) { return static_cast<uint64_t>(restarts) << 32; }

}  // namespace

bool has_ended(v1::JobState state) {
  return state == v1::JOB_STATE_SUCCEEDED || state == v1::JOB_STATE_FAILED ||
         state == v1::JOB_STATE_CANCELLED;
}

Job::Job(const std::string& id, const v1::CreateJobRequest& request, const v1::RenderSettings& settings,
         JobServices& services, std::optional<TraceContext> client)
    : id_(id),
      request_(request),
      request_hash_(hash_of(request)),
      scene_id_(parse_scene_name(request.scene())),
      services_(services),
      settings_(settings),
      priority_(known_priority(request.priority())),
      board_(tile_count(request_, settings_), seconds(settings_.update_interval_seconds())),
      trace_(services.traces, std::move(client), "job", {{"fogbank.job", job_name(id)}}) {
  trace_.begin("queue");
  base_.set_name(job_name(id));
  base_.set_scene(request.scene());
  *base_.mutable_settings() = settings_;
  base_.set_state(v1::JOB_STATE_QUEUED);
  *base_.mutable_create_time() = timestamp_now();
  base_.mutable_progress()->set_tiles_total(static_cast<int32_t>(tile_count(request_, settings_)));
  base_.set_request_id(request.request_id());
  base_.set_priority(priority_);
  base_.set_leased(request.leased());
  base_.set_fill_only(request.fill_only());
}

Job::Job(StoredJob stored, JobServices& services)
    : id_(parse_job_name(stored.description.name())),
      request_(std::move(stored.request)),
      request_hash_(hash_of(request_)),
      scene_id_(parse_scene_name(stored.description.scene())),
      services_(services),
      settings_(stored.description.settings()),
      priority_(known_priority(stored.description.priority())),
      base_(std::move(stored.description)),
      board_(has_ended(base_.state())
                 ? TileBoard::published(tile_count(request_, settings_), base_.revision())
                 : TileBoard(tile_count(request_, settings_), seconds(settings_.update_interval_seconds()),
                             first_revision(base_.restarts() + 1))),
      trace_(has_ended(base_.state()) ? nullptr : services.traces, std::nullopt, "job",
             {{"fogbank.job", base_.name()}}) {
  if (has_ended(base_.state())) return;
  base_.set_restarts(base_.restarts() + 1);
  base_.clear_start_time();
  paused_ = base_.state() == v1::JOB_STATE_PAUSED;
  if (!paused_) base_.set_state(v1::JOB_STATE_QUEUED);
  if (base_.has_error()) {
    // It was being cancelled.
    base_.set_state(v1::JOB_STATE_CANCELLED);
    *base_.mutable_end_time() = timestamp_now();
    board_.advance();
  }
}

int64_t Job::film_bytes() const {
  if (fill_only()) return 0;
  // Two half buffers of each layer, twice while one pass follows another (render/film.h); and once more for
  // a checkpoint that is being written.
  const int64_t pixel_bytes = (uses_cache() ? 2 : 1) * 3 * 48;
  return pixel_bytes * settings_.crop().width() * settings_.crop().height();
}

int64_t Job::image_bytes() const {
  if (fill_only()) return 0;
  const int64_t channels = (settings_.variance() ? 6 : 3) + settings_.aovs_size();
  const int64_t channel_bytes = settings_.pixel_type() == v1::PIXEL_TYPE_FLOAT ? 4 : 2;
  return channels * channel_bytes * settings_.crop().width() * settings_.crop().height();
}

StoredJob Job::stored() const { return {.request = request_, .description = describe()}; }

bool Job::uses_cache() const { return service::uses_cache(settings_.integrator()); }

std::optional<uint64_t> Job::epoch() const {
  return settings_.has_epoch() ? std::optional<uint64_t>(settings_.epoch()) : std::nullopt;
}

void Job::start(const std::shared_ptr<const transport::World>& world, render::RenderSettings engine,
                double load_seconds) {
  if (ended()) return;
  scene_fingerprint_ = world->scene().fingerprint;
  std::optional<scene::FieldIdentity> field;
  if (engine.integrator_settings.cache) field = cache::record_field(world->scene(), max_depth());
  std::shared_ptr<render::RenderJob> render_job;
  try {
    render_job = make_render_job(world, engine);
  } catch (...) {
    fail(to_rpc_error(std::current_exception()));
    return;
  }
  const std::lock_guard lock(mutex_);
  if (stop_ || suspended_ || has_ended(base_.state())) return;
  engine_settings_ = std::move(engine);
  render_job_ = std::move(render_job);
  field_ = std::move(field);
  load_seconds_ += load_seconds;
  trace_.add("load", load_seconds);
  // Held for as long as tiles may be wanted; the film itself is shared with it.
  kept_tile_source_ = film_tiles(render_job_);
  tile_source_ = kept_tile_source_;
  checkpoint_passes_ = render_job_->progress().passes_done;
  if (checkpoint_passes_ == 0) return;
  const Clock::time_point now = Clock::now();
  for (uint32_t tile = 0; tile < render_job_->tile_count(); ++tile) board_.complete(tile, now);
}

std::function<void()> Job::take() {
  const std::lock_guard lock(mutex_);
  if (!render_job_ || stop_ || paused_ || suspended_ || finishing_) return {};
  const std::optional<render::Task> task = render_job_->next_task();
  if (!task) {
    finish_if_idle();
    return {};
  }
  const uint64_t number = next_task_++;
  running_.emplace(number, RunningTask{.task = *task, .start = Clock::now()});
  const bool is_tile = std::holds_alternative<render::TileTask>(*task);
  if (is_tile) trace_.end("fill");
  trace_.begin(is_tile ? "tiles" : "fill");
  if (base_.state() == v1::JOB_STATE_QUEUED) {
    trace_.end("queue");
    base_.set_state(v1::JOB_STATE_RUNNING);
    *base_.mutable_start_time() = timestamp_now();
    board_.advance();
  }
  return
      [self = shared_from_this(), job = render_job_, task = *task, number] { self->run(*job, task, number); };
}

void Job::run(render::RenderJob& job, const render::Task& task, uint64_t number) {
  const double cpu_before = thread_cpu_seconds();
  bool pass_completed = false;
  try {
    FOGBANK_FAILPOINT("job.before_task");
    pass_completed = job.run(task, interrupt_);
  } catch (...) {
    fail(to_rpc_error(std::current_exception()));
  }
  const double cpu = thread_cpu_seconds() - cpu_before;
  {
    const std::lock_guard lock(mutex_);
    if (running_.extract(number).mapped().given_up) {
      services_.lost_threads -= 1;
      return;
    }
    render_cpu_seconds_ += cpu;
    if (leased() && !std::holds_alternative<render::PlanTask>(task)) {
      ++own_tasks_;
      own_cpu_seconds_ += cpu;
    }
    const auto* const tile = std::get_if<render::TileTask>(&task);
    if (!stop_) account(tile != nullptr ? std::optional(tile->tile) : std::nullopt, pass_completed);
    finish_if_idle();
  }
  if (leased()) services_.settle(shared_from_this());
  services_.changed();
}

void Job::account(std::optional<uint32_t> tile, bool pass_completed) {
  const Clock::time_point now = Clock::now();
  ray_rate_.record(render_job_->progress().rays, now);
  ++tasks_completed_;
  if (!tile) return;
  services_.tiles += 1;
  if (!pass_completed) {
    // What an interruption came into may or may not have been done; its tile is told of with the pass.
    if (interrupt_) {
      doubtful_tiles_.push_back(*tile);
    } else {
      board_.complete(*tile, now);
      unfinished_pass_.push_back(*tile);
    }
    return;
  }
  board_.complete(*tile, now);
  for (const uint32_t doubtful : doubtful_tiles_) board_.complete(doubtful, now);
  doubtful_tiles_.clear();
  unfinished_pass_.clear();
  trace_.end("tiles", {{"fogbank.passes", static_cast<int64_t>(render_job_->progress().passes_done)},
                       {"fogbank.tiles", static_cast<int64_t>(render_job_->tile_count())}});
  checkpoint_if_due();
}

void Job::finish_if_idle() {
  if (finishing_ || has_running_tasks()) return;
  const bool ended = stop_ || (render_job_ && render_job_->ended());
  if (!ended && !suspended_) return;
  finishing_ = true;
  if (!ended) {
    services_.writer.post([self = shared_from_this()] { self->finish_suspension(); });
    return;
  }
  const Clock::time_point now = Clock::now();
  // A job that ran out of time in the middle of a pass goes back to the pass before, in the tiles of that
  // pass.
  for (const auto* const tiles : {&unfinished_pass_, &doubtful_tiles_}) {
    for (const uint32_t tile : *tiles) board_.complete(tile, now);
  }
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
    for (const char* const part : {"fill", "tiles"}) trace_.end(part);
    if (!failure) trace_.begin("encode");
  }
  if (!failure) {
    try {
      describe_result(*description.mutable_result());
      if (fill_only()) {
        keep_epoch(*description.mutable_result());
      } else {
        store_image(*description.mutable_result());
      }
    } catch (...) {
      failure = to_rpc_error(std::current_exception());
      description.clear_result();
    }
  }
  description.mutable_progress()->clear_eta_seconds();
  description.mutable_progress()->set_rays_per_second(0);
  description.clear_error();
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

void Job::describe_result(v1::JobResult& result) const {
  // Only this thread touches the film now; render_job_ stays until `end`.
  const render::Progress progress = render_job_->progress();
  *result.mutable_window() = settings_.crop();
  result.set_film_width(settings_.width());
  result.set_film_height(settings_.height());
  result.set_samples_per_pixel(static_cast<int32_t>(progress.samples_per_pixel));
  result.set_samples(progress.samples_done);
  result.set_rays(progress.rays);
  result.set_load_seconds(load_seconds_);
  result.set_render_seconds(progress.render_seconds);
  result.set_render_cpu_seconds(progress.cpu_seconds);
  if (progress.estimate.noise) result.set_relative_noise(*progress.estimate.noise);
  result.set_invalid_samples(progress.invalid_samples);
  if (field_) result.set_cache(cache_name(field_->transport));
  result.set_records_reused(progress.records_reused);
  result.set_records_new(progress.records_new);
  result.set_epoch(progress.epoch);
  for (const render::HistoryEntry& entry : render_job_->history()) *result.add_history() = to_message(entry);
}

void Job::keep_epoch(v1::JobResult& result) {
  if (field_) result.set_epoch(services_.keep_epoch(*field_));
}

void Job::store_image(v1::JobResult& result) {
  // Records are on the disk before anybody hears that the job made them.
  if (const auto& cache = engine_settings_.integrator_settings.cache) cache->save();
  const std::string file =
      render::encode_image(render_job_->image(), pixel_type(settings_), settings_.variance(),
                           render::describe(engine_settings_, render_job_->progress(), render_job_->history(),
                                            scene_fingerprint_));
  FOGBANK_FAILPOINT("job.before_image");
  write_file_durably(image_path(), file);
  FOGBANK_FAILPOINT("job.after_image");
  result.set_image_bytes(static_cast<int64_t>(file.size()));
  result.set_image_sha256(sha256(file));
}

void Job::end(v1::Job description) {
  std::unique_lock one_at_a_time(store_mutex_);
  // Durable before anybody hears of it. Should the disk refuse, the end itself is still told to those who
  // watch, and the next life of the server comes to it again.
  try {
    FOGBANK_FAILPOINT("job.before_end");
    services_.store.put({{.request = request_, .description = description}});
    FOGBANK_FAILPOINT("job.after_end");
    std::error_code ignored;
    std::filesystem::remove(checkpoint_path(), ignored);
  } catch (const std::exception& error) {
    spdlog::error("{}: {}", description.name(), error.what());
  }
  std::shared_ptr<render::RenderJob> released;
  std::shared_ptr<const TileSource> released_source;
  {
    const std::lock_guard lock(mutex_);
    base_ = std::move(description);
    board_.advance();
    trace_.finish({{"fogbank.state", v1::JobState_Name(base_.state())}},
                  base_.state() == v1::JOB_STATE_FAILED);
    released = std::move(render_job_);
    render_job_ = nullptr;
    engine_settings_.integrator_settings.cache = nullptr;
    engine_settings_.reference = nullptr;
    if (watchers_ == 0) released_source = std::move(kept_tile_source_);
  }
  one_at_a_time.unlock();
  services_.ended(shared_from_this());
  services_.changed();
}

v1::JobState Job::state() const {
  const std::lock_guard lock(mutex_);
  return base_.state();
}

bool Job::ended() const { return has_ended(state()); }

bool Job::active() const {
  const std::lock_guard lock(mutex_);
  if (!render_job_ || paused_ || suspended_ || finishing_ || has_ended(base_.state())) return false;
  return !leased() || render_job_->caller_due();
}

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
  description.mutable_progress()->set_paused(paused_ && !has_ended(base_.state()));
  return description;
}

v1::Progress Job::describe_progress() const {
  v1::Progress message = to_message(render_job_->progress(), render_job_->history(), engine_settings_);
  message.set_tiles_total(static_cast<int32_t>(tile_count(request_, settings_)));
  message.set_rays_per_second(paused_ ? 0 : ray_rate_.rate());
  message.set_paused(paused_);
  return message;
}

}  // namespace fogbank::service
