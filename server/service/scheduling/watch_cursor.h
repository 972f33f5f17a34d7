// What one watcher of a job is to be sent next.
#pragma once

#include <cstdint>

#include "service/scheduling/clock.h"
#include "service/scheduling/tile_board.h"

namespace fogbank::service {

/// The state machine of one WatchJob stream: a snapshot, then tiles, progress and heartbeats, then exactly
/// one `ended`. It is asked for the next event only when the stream can take one, so nothing is ever queued.
/// Not thread-safe.
class WatchCursor {
 public:
  struct Options {
    uint64_t since_revision = 0;  ///< the watcher has everything up to here
    bool tiles = true;
    Clock::duration interval{};  ///< least time between two updates of one tile; 0: the board's alone
    Clock::duration progress_interval = std::chrono::milliseconds(500);
    Clock::duration heartbeat_interval = std::chrono::seconds(10);
  };

  enum class Event : uint8_t { none, snapshot, tile, progress, heartbeat, ended };

  /// The job as the cursor needs to know it.
  struct JobView {
    const TileBoard& board;
    bool ended = false;
    bool succeeded = false;       ///< only then the remaining tiles are worth sending
    uint64_t progress_count = 0;  ///< changes whenever there is progress to report
  };

  struct Decision {
    Event event = Event::none;
    uint32_t tile = 0;           ///< with Event::tile
    uint64_t revision = 0;       ///< what the watcher can resume from once it has the event
    Clock::time_point retry_at;  ///< with Event::none: ask again then, if nothing happens before
  };

  WatchCursor(const Options& options, Clock::time_point now)
      : options_(options), cursor_(options.since_revision), last_event_(now), last_progress_(now) {}

  /// Decides and takes the event for sent. After Event::ended there is nothing but Event::none.
  Decision next(const JobView& job, Clock::time_point now);

  /// The watcher has everything up to this revision.
  uint64_t revision() const { return cursor_; }
  bool wants_tiles() const { return options_.tiles; }

 private:
  /// The tile to send, if any may be sent now; else `retry_at` is lowered to when one may.
  bool next_tile(const JobView& job, Clock::time_point now, Decision& decision);

  Options options_;
  uint64_t cursor_;
  bool snapshot_sent_ = false;
  bool ended_sent_ = false;
  Clock::time_point last_event_;
  Clock::time_point last_progress_;
  uint64_t progress_sent_ = 0;
  // With an interval of its own a watcher is served in rounds: a round sends what had been published when it
  // began, which holds each tile once, and the next one begins an interval later.
  Clock::time_point round_start_ = Clock::time_point::min();
  uint64_t round_end_revision_ = 0;
};

}  // namespace fogbank::service
