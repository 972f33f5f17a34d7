#include "service/scheduling/scheduler.h"

#include <gtest/gtest.h>

#include <atomic>
#include <semaphore>
#include <thread>

namespace fogbank::service {
namespace {

/// Tasks that spin for a fixed time, until `limit` were taken.
class SpinningWorkload : public Workload {
 public:
  SpinningWorkload(Clock::duration task, int limit, int threads = 1000, int group = 0, int urgency = 0)
      : task_(task), left_(limit), threads_(threads), group_(group), urgency_(urgency) {}

  std::function<void()> take() override {
    if (left_ == 0) return {};
    --left_;
    return [this] {
      const int now_running = ++running_;
      int most = most_running_.load();
      while (now_running > most && !most_running_.compare_exchange_weak(most, now_running)) {
      }
      const Clock::time_point end = Clock::now() + task_;
      while (Clock::now() < end) std::this_thread::yield();
      --running_;
      ++done_;
    };
  }
  int max_threads() const override { return threads_; }
  int group() const override { return group_; }
  int urgency() const override { return urgency_; }
  int done() const { return done_; }
  int most_running() const { return most_running_; }

 private:
  Clock::duration task_;
  int left_;
  int threads_;
  int group_;
  int urgency_;
  std::atomic<int> running_ = 0;
  std::atomic<int> most_running_ = 0;
  std::atomic<int> done_ = 0;
};

void wait_for(const std::function<bool()>& condition) {
  while (!condition()) std::this_thread::sleep_for(std::chrono::milliseconds(1));
}

TEST(Scheduler, HoldsAGroupAndLetsItGo) {
  Scheduler scheduler(2, [] {});
  const auto held = std::make_shared<SpinningWorkload>(std::chrono::milliseconds(1), 20, 1000, 1);
  const auto other = std::make_shared<SpinningWorkload>(std::chrono::milliseconds(1), 20, 1000, 2);
  scheduler.hold(1, true);
  scheduler.add(held);
  scheduler.add(other);
  wait_for([&] { return other->done() == 20; });
  EXPECT_EQ(held->done(), 0);
  EXPECT_EQ(scheduler.cpu_seconds(1), 0);
  scheduler.hold(1, false);
  wait_for([&] { return held->done() == 20 && scheduler.busy() == 0; });
  EXPECT_GT(scheduler.cpu_seconds(1), 0);
  EXPECT_EQ(scheduler.cpu_seconds(3), 0);
}

TEST(Scheduler, RunsEverythingOnPreparedThreads) {
  static thread_local bool prepared = false;
  std::atomic<int> unprepared = 0;
  class Counting : public Workload {
   public:
    explicit Counting(std::atomic<int>& count) : count_(count) {}
    std::function<void()> take() override {
      if (left_ == 0) return {};
      --left_;
      return [this] {
        if (!prepared) ++count_;
        ++done;
      };
    }
    std::atomic<int> done = 0;

   private:
    int left_ = 500;
    std::atomic<int>& count_;
  };
  auto workload = std::make_shared<Counting>(unprepared);
  Scheduler scheduler(3, [] { prepared = true; });
  scheduler.add(workload);
  wait_for([&] { return workload->done == 500; });
  EXPECT_EQ(unprepared, 0);
}

// Eight workloads with task lengths of 1 : 8 get the same worker time. While all have work, the charged times
// may differ by what is in flight: one longest task for each of the two threads, before and after.
TEST(Scheduler, SharesWorkerTimeNotTasks) {
  Scheduler scheduler(2, [] {});
  std::vector<std::shared_ptr<SpinningWorkload>> workloads;
  for (int i = 1; i <= 8; ++i) {
    workloads.push_back(std::make_shared<SpinningWorkload>(std::chrono::milliseconds(i), 1'000'000));
    scheduler.add(workloads.back());
  }
  std::vector<double> consumed(8, 0.0);
  wait_for([&] {
    for (size_t i = 0; i < 8; ++i) consumed[i] = scheduler.consumed_seconds(*workloads[i]);
    return consumed[0] > 0.2;
  });
  for (const auto& workload : workloads) scheduler.remove(*workload);
  double least = consumed[0];
  double most = consumed[0];
  for (const double seconds_of_one : consumed) {
    least = std::min(least, seconds_of_one);
    most = std::max(most, seconds_of_one);
  }
  // A task may be charged more than its length when the machine is busy, hence not 4 x 8 ms exactly.
  EXPECT_GT(least, 0.5 * most);
  EXPECT_GT(workloads[0]->done(), 2 * workloads[7]->done());
}

TEST(Scheduler, ALateWorkloadStartsLevel) {
  Scheduler scheduler(1, [] {});
  auto early = std::make_shared<SpinningWorkload>(std::chrono::milliseconds(1), 1'000'000);
  scheduler.add(early);
  wait_for([&] { return scheduler.consumed_seconds(*early) > 0.1; });
  auto late = std::make_shared<SpinningWorkload>(std::chrono::milliseconds(1), 1'000'000);
  const int before = early->done();
  scheduler.add(late);
  wait_for([&] { return late->done() >= 40; });
  // Were the late one to catch up first, the early one would have had next to nothing.
  EXPECT_GT(early->done() - before, 10);
}

std::shared_ptr<SpinningWorkload> endless(int group, int urgency = 0) {
  return std::make_shared<SpinningWorkload>(std::chrono::milliseconds(1), 1'000'000, 1000, group, urgency);
}

// One user with one job against another with nine: half of the time each.
TEST(Scheduler, GroupsShareBeforeTheirWorkloads) {
  Scheduler scheduler(2, [] {});
  const auto lone = endless(1);
  scheduler.add(lone);
  std::vector<std::shared_ptr<SpinningWorkload>> many;
  for (int i = 0; i < 9; ++i) {
    many.push_back(endless(2));
    scheduler.add(many.back());
  }
  wait_for([&] { return scheduler.consumed_seconds(*lone) > 0.2; });
  double others = 0;
  for (const auto& workload : many) others += scheduler.consumed_seconds(*workload);
  const double alone = scheduler.consumed_seconds(*lone);
  // Without groups the lone job would have a tenth.
  EXPECT_GT(alone, 0.5 * others);
  EXPECT_GT(others, 0.5 * alone);
}

TEST(Scheduler, TheUrgentOfAGroupGoFirstAndOtherGroupsDoNotMind) {
  Scheduler scheduler(1, [] {});
  const auto batch = endless(1, 2);
  const auto stranger = endless(2, 3);
  scheduler.add(batch);
  scheduler.add(stranger);
  wait_for([&] { return batch->done() > 20 && stranger->done() > 20; });
  const auto urgent = std::make_shared<SpinningWorkload>(std::chrono::milliseconds(1), 100, 1000, 1, 1);
  scheduler.add(urgent);
  const int batch_before = batch->done();
  const int stranger_before = stranger->done();
  wait_for([&] { return urgent->done() == 100; });
  // The task that ran when the urgent ones came, and one that may have been taken after their last.
  EXPECT_LE(batch->done() - batch_before, 2);
  EXPECT_GT(stranger->done() - stranger_before, 50);
  wait_for([&, now = batch->done()] { return batch->done() > now + 10; });
}

TEST(Scheduler, AGroupThatComesBackIsNeitherOwedNorPunished) {
  Scheduler scheduler(1, [] {});
  const auto present = endless(1);
  auto absent = endless(2);
  scheduler.add(present);
  wait_for([&] { return present->done() > 100; });
  scheduler.add(absent);
  wait_for([&] { return absent->done() >= 40; });
  // Had it been owed the hundred, the other would have had next to nothing meanwhile.
  EXPECT_GT(present->done(), 110);
  scheduler.remove(*absent);
  const int before = present->done();
  wait_for([&] { return present->done() > before + 50; });
  absent = endless(2);
  scheduler.add(absent);
  const int again = present->done();
  wait_for([&] { return absent->done() >= 40; });
  EXPECT_GT(present->done() - again, 10);
}

TEST(Scheduler, AddingTwiceIsAddingOnce) {
  Scheduler scheduler(1, [] {});
  const auto workload = endless(1);
  scheduler.add(workload);
  scheduler.add(workload);
  scheduler.remove(*workload);
  const int done = workload->done();
  std::this_thread::sleep_for(std::chrono::milliseconds(20));
  EXPECT_LE(workload->done(), done + 1);
}

TEST(Scheduler, RespectsTheThreadLimitOfAWorkload) {
  Scheduler scheduler(4, [] {});
  auto workload = std::make_shared<SpinningWorkload>(std::chrono::milliseconds(1), 60, 2);
  scheduler.add(workload);
  wait_for([&] { return workload->done() == 60; });
  EXPECT_LE(workload->most_running(), 2);
}

TEST(Scheduler, RemovedWorkloadsGetNoFurtherTaskAndAreReleased) {
  Scheduler scheduler(2, [] {});
  auto workload = std::make_shared<SpinningWorkload>(std::chrono::milliseconds(1), 1'000'000);
  const std::weak_ptr<SpinningWorkload> observer = workload;
  scheduler.add(workload);
  wait_for([&] { return workload->done() > 5; });
  scheduler.remove(*workload);
  workload.reset();
  wait_for([&] { return observer.expired(); });
  EXPECT_EQ(scheduler.busy(), 0);
}

}  // namespace
}  // namespace fogbank::service
