#include "service/scheduling/task_queue.h"

#include <gtest/gtest.h>

#include <atomic>

namespace fogbank::service {
namespace {

TEST(TaskQueue, CloseRunsWhatWasPostedAndRefusesTheRest) {
  TaskQueue queue("test", 3);
  std::atomic<int> done = 0;
  for (int i = 0; i < 1000; ++i) EXPECT_TRUE(queue.post([&] { ++done; }));
  queue.close();
  EXPECT_EQ(done, 1000);
  EXPECT_FALSE(queue.post([&] { ++done; }));
  EXPECT_EQ(done, 1000);
}

TEST(TaskQueue, OneThreadKeepsTheOrder) {
  TaskQueue queue("test", 1);
  std::vector<int> order;
  for (int i = 0; i < 100; ++i) queue.post([&order, i] { order.push_back(i); });
  queue.close();
  for (int i = 0; i < 100; ++i) EXPECT_EQ(order[static_cast<size_t>(i)], i);
}

}  // namespace
}  // namespace fogbank::service
