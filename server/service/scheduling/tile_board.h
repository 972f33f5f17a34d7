// Which tiles of a job changed, in the order in which watchers are to hear of it.
#pragma once

#include <cstdint>
#include <map>
#include <optional>
#include <set>
#include <vector>

#include "service/scheduling/clock.h"

namespace fogbank::service {

/// One board a job serves any number of watchers: a tile stands on it once, under the revision of its newest
/// publication, so that a watcher needs to remember one number (the revision up to which it has everything),
/// a slow one finds the newest state of each tile and never a backlog, and one that comes back goes on where
/// it was.
///
/// A tile's first pixels are published at once. Later ones are published by `publish_due`, at most one per
/// interval and tile, because encoding and sending costs more than a quick pass. Not thread-safe.
class TileBoard {
 public:
  struct Update {
    uint32_t tile = 0;
    uint64_t revision = 0;
  };

  /// Revisions begin above `first_revision`: those of an earlier life of the server must not come again.
  TileBoard(uint32_t tile_count, Clock::duration interval, uint64_t first_revision = 0)
      : interval_(interval), tiles_(tile_count), revision_(first_revision) {}

  /// A board on which every tile is published after `revision`: of a job that ended in an earlier life of the
  /// server, whose watchers may have missed any of them.
  static TileBoard published(uint32_t tile_count, uint64_t revision);

  /// `tile` has new pixels.
  void complete(uint32_t tile, Clock::time_point now);
  /// Publishes tiles with new pixels whose last publication is an interval ago.
  void publish_due(Clock::time_point now);
  /// Publishes all tiles with new pixels.
  void publish_all(Clock::time_point now);
  /// When `publish_due` has something to do next.
  std::optional<Clock::time_point> next_due() const;

  /// Grows with every publication and every `advance`.
  uint64_t revision() const { return revision_; }
  /// Marks a change that is not a tile's.
  void advance() { ++revision_; }

  /// The oldest publication after `revision`.
  std::optional<Update> next_after(uint64_t revision) const;
  /// Number of tiles published after `revision`; linear in it.
  size_t count_after(uint64_t revision) const;

 private:
  struct TileState {
    uint64_t revision = 0;  ///< of the newest publication; 0: none yet
    Clock::time_point published;
    bool deferred = false;
  };

  void publish(uint32_t tile, Clock::time_point now);

  Clock::duration interval_;
  std::vector<TileState> tiles_;
  std::map<uint64_t, uint32_t> by_revision_;
  std::set<std::pair<Clock::time_point, uint32_t>> deferred_;
  uint64_t revision_;
};

}  // namespace fogbank::service
