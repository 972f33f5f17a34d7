#include "service/scheduling/tile_board.h"

#include <gtest/gtest.h>

namespace fogbank::service {
namespace {

using std::chrono::milliseconds;

constexpr Clock::time_point start{};

TEST(TileBoard, FirstPixelsArePublishedAtOnceLaterOnesAfterTheInterval) {
  TileBoard board(2, milliseconds(1000));
  board.complete(0, start);
  EXPECT_EQ(board.revision(), 1u);
  board.complete(0, start + milliseconds(10));
  board.publish_due(start + milliseconds(999));
  EXPECT_EQ(board.revision(), 1u);
  EXPECT_EQ(board.next_due(), start + milliseconds(1000));
  board.publish_due(start + milliseconds(1000));
  EXPECT_EQ(board.revision(), 2u);
  EXPECT_EQ(board.next_due(), std::nullopt);
}

TEST(TileBoard, NewestPublicationOfATileReplacesTheOlder) {
  TileBoard board(2, Clock::duration::zero());
  board.complete(0, start);
  board.complete(1, start);
  board.complete(0, start);
  board.publish_due(start);
  ASSERT_TRUE(board.next_after(0));
  EXPECT_EQ(board.next_after(0)->tile, 1u);
  EXPECT_EQ(board.next_after(2)->tile, 0u);
  EXPECT_EQ(board.next_after(2)->revision, 3u);
  EXPECT_EQ(board.count_after(0), 2u);
  EXPECT_FALSE(board.next_after(3));
}

TEST(TileBoard, PublishAllWaitsForNothing) {
  TileBoard board(1, milliseconds(1000));
  board.complete(0, start);
  board.complete(0, start);
  board.complete(0, start);
  board.publish_all(start);
  EXPECT_EQ(board.revision(), 2u);
  EXPECT_EQ(board.next_due(), std::nullopt);
}

TEST(TileBoard, AnEarlierLifesTilesAreAllNewerThanWhatItsWatchersSaw) {
  const TileBoard board = TileBoard::published(3, 40);
  EXPECT_EQ(board.count_after(40), 3u);
  EXPECT_EQ(board.revision(), 43u);
}

}  // namespace
}  // namespace fogbank::service
