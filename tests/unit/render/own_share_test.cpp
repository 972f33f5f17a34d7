// Whose a leased job's stages are.
#include "render/own_share.h"

#include <gtest/gtest.h>

#include <limits>

namespace fogbank::render {
namespace {

constexpr std::chrono::milliseconds trip{50};
constexpr uint32_t probing = 1;
constexpr uint32_t tiles = 2;

class OwnShareTest : public testing::Test {
 protected:
  OwnShareTest() { share_.set_trip_seconds(0.05, now_); }

  const OwnShare::Clock::time_point now_{std::chrono::seconds{100}};
  OwnShare share_;
};

TEST(OwnShare, EverythingIsLeasedUntilTripsCostSomething) {
  OwnShare share;
  const OwnShare::Clock::time_point now{std::chrono::seconds{100}};
  share.begin_stage(probing, 3, now);
  EXPECT_FALSE(share.keeps(now));
  share.set_trip_seconds(0.05, now);
  EXPECT_TRUE(share.keeps(now)) << "it has begun before anybody could say what a trip takes";
  share.set_trip_seconds(0, now);
  EXPECT_TRUE(share.keeps(now)) << "counts from the next stage on";
  share.begin_stage(probing, 3, now);
  EXPECT_FALSE(share.keeps(now));
}

TEST_F(OwnShareTest, WhatIsUnknownIsTriedForATrip) {
  share_.begin_stage(probing, 1000, now_);
  EXPECT_TRUE(share_.keeps(now_));
  EXPECT_TRUE(share_.keeps(now_ + trip - std::chrono::milliseconds{1}));
  EXPECT_FALSE(share_.keeps(now_ + trip));
  EXPECT_EQ(share_.kept_until(), now_ + trip);
}

TEST_F(OwnShareTest, TheFirstTaskTellsThatTheStageIsLong) {
  share_.begin_stage(probing, 1000, now_);
  share_.learn(1, 0.001, now_);
  EXPECT_FALSE(share_.keeps(now_)) << "999 times 1 ms are left";
  share_.begin_stage(probing, 20, now_);
  EXPECT_TRUE(share_.keeps(now_)) << "20 ms";
  share_.begin_stage(tiles, 1000, now_);
  EXPECT_TRUE(share_.keeps(now_)) << "of these nothing is known";
  share_.begin_stage(probing, 1000, now_);
  EXPECT_FALSE(share_.keeps(now_)) << "that is still known";
}

TEST_F(OwnShareTest, WorkThatIsDoneCountsNoMore) {
  share_.begin_stage(probing, 100, now_);
  share_.learn(60, 0.06, now_);
  EXPECT_TRUE(share_.keeps(now_)) << "40 times 1 ms are left";
}

TEST_F(OwnShareTest, StagesThatOnlyReplicasCanPerform) {
  share_.begin_stage(probing, 1, now_);
  share_.begin_leased_stage();
  EXPECT_FALSE(share_.keeps(now_));
  share_.learn(1, 0.001, now_);
  EXPECT_FALSE(share_.keeps(now_));
}

TEST_F(OwnShareTest, NonsenseTeachesNothing) {
  share_.begin_stage(probing, 10, now_);
  share_.learn(0, 1000, now_);
  share_.learn(1, -1, now_);
  share_.learn(1, std::numeric_limits<double>::quiet_NaN(), now_);
  EXPECT_TRUE(share_.keeps(now_));
}

}  // namespace
}  // namespace fogbank::render
