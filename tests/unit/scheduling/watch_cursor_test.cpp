#include "service/scheduling/watch_cursor.h"

#include <gtest/gtest.h>

#include <random>
#include <vector>

namespace fogbank::service {
namespace {

using Event = WatchCursor::Event;
using std::chrono::milliseconds;

constexpr Clock::time_point start{};

TEST(WatchCursor, SnapshotFirstThenTilesThenExactlyOneEnd) {
  TileBoard board(2, Clock::duration::zero());
  board.complete(0, start);
  WatchCursor cursor({}, start);
  EXPECT_EQ(cursor.next({board}, start).event, Event::snapshot);
  const auto tile = cursor.next({board}, start);
  EXPECT_EQ(tile.event, Event::tile);
  EXPECT_EQ(tile.tile, 0u);
  EXPECT_EQ(cursor.next({board}, start).event, Event::none);

  board.complete(1, start);
  const WatchCursor::JobView ended{.board = board, .ended = true, .succeeded = true};
  EXPECT_EQ(cursor.next(ended, start).event, Event::tile);
  const auto end = cursor.next(ended, start);
  EXPECT_EQ(end.event, Event::ended);
  EXPECT_EQ(end.revision, board.revision());
  for (int i = 0; i < 3; ++i) EXPECT_EQ(cursor.next(ended, start + std::chrono::hours(i)).event, Event::none);
}

TEST(WatchCursor, AJobThatFailedEndsWithoutItsRemainingTiles) {
  TileBoard board(2, Clock::duration::zero());
  board.complete(0, start);
  WatchCursor cursor({}, start);
  const WatchCursor::JobView failed{.board = board, .ended = true, .succeeded = false};
  EXPECT_EQ(cursor.next(failed, start).event, Event::snapshot);
  EXPECT_EQ(cursor.next(failed, start).event, Event::ended);
}

TEST(WatchCursor, HeartbeatAfterSilenceOnly) {
  TileBoard board(1, Clock::duration::zero());
  WatchCursor cursor({.heartbeat_interval = milliseconds(100)}, start);
  EXPECT_EQ(cursor.next({board}, start).event, Event::snapshot);
  const auto none = cursor.next({board}, start + milliseconds(99));
  EXPECT_EQ(none.event, Event::none);
  EXPECT_EQ(none.retry_at, start + milliseconds(100));
  EXPECT_EQ(cursor.next({board}, start + milliseconds(100)).event, Event::heartbeat);
  EXPECT_EQ(cursor.next({board}, start + milliseconds(101)).event, Event::none);
}

TEST(WatchCursor, ProgressAtItsOwnPaceAndOnlyWhenThereIsAny) {
  TileBoard board(1, Clock::duration::zero());
  WatchCursor cursor({.progress_interval = milliseconds(50)}, start);
  cursor.next({board}, start);
  const WatchCursor::JobView moved{.board = board, .progress_count = 7};
  EXPECT_EQ(cursor.next(moved, start + milliseconds(10)).event, Event::none);
  EXPECT_EQ(cursor.next(moved, start + milliseconds(10)).retry_at, start + milliseconds(50));
  EXPECT_EQ(cursor.next(moved, start + milliseconds(50)).event, Event::progress);
  EXPECT_EQ(cursor.next(moved, start + milliseconds(500)).event, Event::none);
}

TEST(WatchCursor, WithoutTilesOnlyTheRest) {
  TileBoard board(1, Clock::duration::zero());
  board.complete(0, start);
  WatchCursor cursor({.tiles = false}, start);
  EXPECT_EQ(cursor.next({board}, start).event, Event::snapshot);
  EXPECT_EQ(cursor.next({board}, start).event, Event::none);
  EXPECT_EQ(cursor.next({.board = board, .ended = true, .succeeded = true}, start).event, Event::ended);
}

TEST(WatchCursor, OwnIntervalSendsEachTileOncePerRoundAndAllAtTheEnd) {
  TileBoard board(2, Clock::duration::zero());
  WatchCursor cursor({.interval = milliseconds(1000)}, start);
  board.complete(0, start);
  board.complete(1, start);
  cursor.next({board}, start);
  EXPECT_EQ(cursor.next({board}, start).tile, 0u);
  board.complete(0, start);
  board.publish_due(start);
  EXPECT_EQ(cursor.next({board}, start).tile, 1u);
  const auto wait = cursor.next({board}, start + milliseconds(999));
  EXPECT_EQ(wait.event, Event::none);
  EXPECT_EQ(wait.retry_at, start + milliseconds(1000));
  EXPECT_EQ(cursor.next({board}, start + milliseconds(1000)).event, Event::tile);
  board.complete(1, start + milliseconds(1001));
  board.publish_due(start + milliseconds(1001));
  const WatchCursor::JobView ended{.board = board, .ended = true, .succeeded = true};
  EXPECT_EQ(cursor.next(ended, start + milliseconds(1001)).event, Event::tile);
  EXPECT_EQ(cursor.next(ended, start + milliseconds(1001)).event, Event::ended);
}

TEST(WatchCursor, ARevisionOfAnotherServerStartsAnew) {
  TileBoard board(1, Clock::duration::zero());
  board.complete(0, start);
  WatchCursor cursor({.since_revision = 1000}, start);
  EXPECT_EQ(cursor.next({board}, start).event, Event::snapshot);
  EXPECT_EQ(cursor.next({board}, start).event, Event::tile);
}

// A watcher that reads at random moments, breaks off and resumes by revision at random, ends with the newest
// state of every tile, having been sent no more than a tile for each publication.
TEST(WatchCursor, ResumingAtAnyMomentLosesNothing) {
  // NOLINTNEXTLINE(bugprone-random-generator-seed): the same moments in every run
  std::mt19937 random(7);
  for (int trial = 0; trial < 200; ++trial) {
    constexpr uint32_t tiles = 12;
    TileBoard board(tiles, milliseconds(trial % 3 == 0 ? 5 : 0));
    std::vector<int> truth(tiles, 0);
    std::vector<int> seen(tiles, 0);
    uint64_t resume = 0;
    size_t sent = 0;
    WatchCursor cursor({}, start);
    Clock::time_point now = start;
    auto read = [&](bool ended) {
      const auto decision = cursor.next({.board = board, .ended = ended, .succeeded = ended}, now);
      if (decision.event == Event::tile) {
        seen[decision.tile] = truth[decision.tile];
        ++sent;
      }
      if (decision.event != Event::none) {
        EXPECT_GE(decision.revision, resume);
        resume = decision.revision;
      }
      return decision.event;
    };
    for (int step = 0; step < 200; ++step) {
      now += milliseconds(1);
      switch (random() % 4) {
        case 0:
        case 1: {
          const uint32_t tile = random() % tiles;
          ++truth[tile];
          board.complete(tile, now);
          board.publish_due(now);
          break;
        }
        case 2:
          read(false);
          break;
        default:
          if (random() % 8 == 0) cursor = WatchCursor({.since_revision = resume}, now);
      }
    }
    board.publish_all(now);
    Event event = Event::none;
    for (int step = 0; step < 100 && event != Event::ended; ++step) event = read(true);
    EXPECT_EQ(event, Event::ended);
    EXPECT_EQ(seen, truth);
    EXPECT_LE(sent, board.revision());
  }
}

}  // namespace
}  // namespace fogbank::service
