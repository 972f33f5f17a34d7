#include "service/scheduling/watch_cursor.h"

#include <algorithm>

namespace fogbank::service {

WatchCursor::Decision WatchCursor::next(const JobView& job, Clock::time_point now) {
  Decision decision;
  decision.retry_at = Clock::time_point::max();
  if (ended_sent_) return decision;

  // A revision from the future is another server's; such a watcher knows nothing of this one.
  if (cursor_ > job.board.revision()) cursor_ = 0;

  if (!snapshot_sent_) {
    snapshot_sent_ = true;
    progress_sent_ = job.progress_count;  // the snapshot brings it
    decision.event = Event::snapshot;
  } else if (job.ended && !(options_.tiles && job.succeeded && job.board.next_after(cursor_))) {
    ended_sent_ = true;
    cursor_ = job.board.revision();
    decision.event = Event::ended;
  } else if (!job.ended && job.progress_count != progress_sent_ &&
             now - last_progress_ >= options_.progress_interval) {
    progress_sent_ = job.progress_count;
    last_progress_ = now;
    decision.event = Event::progress;
  } else if (next_tile(job, now, decision)) {
    decision.event = Event::tile;
  } else if (now - last_event_ >= options_.heartbeat_interval) {
    decision.event = Event::heartbeat;
  }

  if (decision.event != Event::none) {
    last_event_ = now;
    decision.revision = cursor_;
    return decision;
  }
  decision.retry_at = std::min(decision.retry_at, last_event_ + options_.heartbeat_interval);
  if (job.progress_count != progress_sent_) {
    decision.retry_at = std::min(decision.retry_at, last_progress_ + options_.progress_interval);
  }
  return decision;
}

bool WatchCursor::next_tile(const JobView& job, Clock::time_point now, Decision& decision) {
  if (!options_.tiles) {
    cursor_ = job.board.revision();
    return false;
  }
  const auto update = job.board.next_after(cursor_);
  if (!update) {
    cursor_ = job.board.revision();  // what was published since is nothing that this watcher has to be sent
    return false;
  }
  if (options_.interval > Clock::duration::zero() && !job.ended && update->revision > round_end_revision_) {
    if (round_start_ != Clock::time_point::min() && now - round_start_ < options_.interval) {
      decision.retry_at = std::min(decision.retry_at, round_start_ + options_.interval);
      return false;
    }
    round_start_ = now;
    round_end_revision_ = job.board.revision();
  }
  cursor_ = update->revision;
  decision.tile = update->tile;
  return true;
}

}  // namespace fogbank::service
