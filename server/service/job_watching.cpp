// The part of Job that serves its watchers.
#include <algorithm>

#include "render/exr.h"
#include "service/job.h"
#include "service/limits.h"

namespace fogbank::service {

namespace {
/// Pause before looking again at tiles that are due but held back by their cost.
constexpr Clock::duration cost_pause = std::chrono::milliseconds(100);

/// What a job keeps of encoded tiles for watchers that come to them later.
constexpr size_t max_encoded_bytes = 16 << 20;
}  // namespace

void Job::attach() {
  const std::lock_guard lock(mutex_);
  ++watchers_;
  // A new watcher is to see the job as it is now.
  board_.publish_all(Clock::now());
}

void Job::detach() {
  std::shared_ptr<const TileSource> released;
  const std::lock_guard lock(mutex_);
  if (--watchers_ > 0) return;
  if (!render_job_) released = std::move(kept_tile_source_);
  encoded_.clear();
  encoded_bytes_ = 0;
}

void Job::publish_tiles(Clock::time_point now) {
  if (encode_cpu_seconds_ <= limits::streaming_share * render_cpu_seconds_) board_.publish_due(now);
}

Job::NextEvent Job::next_event(WatchCursor& cursor) {
  NextEvent next;
  uint32_t tile = 0;
  {
    const std::lock_guard lock(mutex_);
    if (suspended_ && !has_ended(base_.state())) throw shutting_down();
    const Clock::time_point now = Clock::now();
    publish_tiles(now);
    const WatchCursor::Decision decision = cursor.next({.board = board_,
                                                        .ended = has_ended(base_.state()),
                                                        .succeeded = base_.state() == v1::JOB_STATE_SUCCEEDED,
                                                        .progress_count = tasks_completed_},
                                                       now);
    if (decision.event == WatchCursor::Event::none) {
      next.retry_at = decision.retry_at;
      if (const auto due = board_.next_due())
        next.retry_at = std::min(next.retry_at, std::max(*due, now + cost_pause));
      return next;
    }
    next.message.emplace();
    next.message->set_revision(decision.revision);
    switch (decision.event) {
      case WatchCursor::Event::snapshot: {
        v1::Snapshot& snapshot = *next.message->mutable_snapshot();
        *snapshot.mutable_job() = describe_locked();
        *snapshot.mutable_window() = settings_.crop();
        const bool tiles_follow = cursor.wants_tiles() && base_.state() != v1::JOB_STATE_FAILED &&
                                  base_.state() != v1::JOB_STATE_CANCELLED;
        if (tiles_follow)
          snapshot.set_pending_tiles(static_cast<int32_t>(board_.count_after(cursor.revision())));
        return next;
      }
      case WatchCursor::Event::progress:
        *next.message->mutable_progress() = describe_locked().progress();
        return next;
      case WatchCursor::Event::heartbeat:
        next.message->mutable_heartbeat();
        return next;
      case WatchCursor::Event::ended:
        *next.message->mutable_ended()->mutable_job() = describe_locked();
        next.last = true;
        return next;
      case WatchCursor::Event::tile:
      case WatchCursor::Event::none:
        tile = decision.tile;
    }
  }
  *next.message->mutable_tile() = *encoded_tile(tile, next.message->revision());
  return next;
}

std::shared_ptr<const TileSource> Job::tile_source() {
  v1::Job description;
  {
    const std::lock_guard lock(mutex_);
    if (auto source = tile_source_.lock()) return source;
    description = base_;
  }
  std::shared_ptr<const TileSource> source = stored_tiles(image_path(), description);
  const std::lock_guard lock(mutex_);
  tile_source_ = source;
  if (watchers_ > 0) kept_tile_source_ = source;
  return source;
}

std::shared_ptr<const v1::Tile> Job::encoded_tile(uint32_t index, uint64_t revision) {
  {
    const std::lock_guard lock(mutex_);
    if (const auto found = encoded_.find(revision); found != encoded_.end()) return found->second;
  }
  const std::shared_ptr<const TileSource> source = tile_source();
  const double cpu_before = thread_cpu_seconds();
  const render::TilePixels pixels = source->tile(index);
  const render::PixelType type = pixel_type(settings_);
  auto tile = std::make_shared<v1::Tile>();
  v1::Window& window = *tile->mutable_window();
  window.set_x(pixels.window.x);
  window.set_y(pixels.window.y);
  window.set_width(pixels.window.width);
  window.set_height(pixels.window.height);
  tile->set_pass(static_cast<int32_t>(pixels.pass));
  tile->set_samples_per_pixel(static_cast<int32_t>(pixels.samples));
  tile->set_exr(render::encode_tile(pixels, settings_.width(), settings_.height(), type,
                                    render::tile_compression(pixels.window, type)));
  const double cpu = thread_cpu_seconds() - cpu_before;
  const std::lock_guard lock(mutex_);
  encode_cpu_seconds_ += cpu;
  if (watchers_ > 1 && encoded_.emplace(revision, tile).second) {
    encoded_bytes_ += tile->exr().size();
    while (encoded_bytes_ > max_encoded_bytes) {
      encoded_bytes_ -= encoded_.begin()->second->exr().size();
      encoded_.erase(encoded_.begin());
    }
  }
  return tile;
}

}  // namespace fogbank::service
