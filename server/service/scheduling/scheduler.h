// Shares the render threads between jobs.
#pragma once

#include <condition_variable>
#include <cstdint>
#include <functional>
#include <limits>
#include <map>
#include <memory>
#include <mutex>
#include <thread>
#include <vector>

#include "service/scheduling/clock.h"

namespace fogbank::service {

/// The tasks of one job, as the scheduler sees them.
class Workload {
 public:
  virtual ~Workload() = default;
  /// The next task, or an empty function when there is none at the moment. Called with the scheduler's lock
  /// held: must be quick and must not call the scheduler. The task must not throw.
  virtual std::function<void()> take() = 0;
  /// Most tasks to run at once.
  virtual int max_threads() const { return std::numeric_limits<int>::max(); }
  /// Whose it is: groups share the threads before their workloads do. Does not change.
  virtual int group() const { return 0; }
  /// Of one group's workloads those with the smallest number have the threads to themselves for as long as
  /// they have tasks. Does not change.
  virtual int urgency() const { return 0; }
};

/// Fair by worker time: a free thread takes a task of the group that has had the least, and there of the most
/// urgent workload that has had the least, so that every active group, and in it every active job of the same
/// urgency, gets the same share of the threads however long its tasks are. What arrives late starts level
/// with the least served one: it neither waits for the others' past nor is made to pay for it. A workload
/// that has no tasks for long is to be removed meanwhile. Thread-safe.
class Scheduler {
 public:
  /// `prepare_thread` runs once on every thread before its first task.
  Scheduler(int threads, std::function<void()> prepare_thread);
  /// As `close`.
  ~Scheduler();

  /// Nothing happens if it is there already.
  void add(std::shared_ptr<Workload> workload);
  /// No further task of it is taken; those that run go on.
  void remove(const Workload& workload);
  /// Looks for tasks again: a workload that had none has one now.
  void wake();
  int threads() const { return static_cast<int>(threads_.size()); }
  int busy() const;
  /// No task of a group is taken for as long as it is held; those that run go on.
  void hold(int group, bool held);
  /// CPU time of the tasks of a group, since the start.
  double cpu_seconds(int group) const;
  /// Worker time that a workload has had since it was added, its head start not counted; 0 for an unknown
  /// one.
  double consumed_seconds(const Workload& workload) const;
  /// Ends the threads after their present tasks.
  void close();

 private:
  struct Entry {
    std::shared_ptr<Workload> workload;
    double head_start = 0;  ///< seconds that count as consumed at arrival
    double consumed = 0;    ///< seconds
    double last_task = 0;   ///< seconds; the running tasks are charged as much in advance
    int running = 0;

    double virtual_time() const { return head_start + consumed + running * last_task; }
  };
  struct Group {
    double time = 0;        ///< seconds consumed, or counted as such at arrival
    double in_advance = 0;  ///< charged for running tasks
    int workloads = 0;
    double cpu_seconds = 0;
    bool held = false;

    double virtual_time() const { return time + in_advance; }
  };

  void work();
  /// The entry whose task to run and the task; with `mutex_` held.
  std::pair<std::shared_ptr<Entry>, std::function<void()>> take();

  mutable std::mutex mutex_;
  std::condition_variable wake_;
  std::vector<std::shared_ptr<Entry>> entries_;
  std::map<int, Group> groups_;
  int busy_ = 0;
  bool closed_ = false;
  std::function<void()> prepare_thread_;
  std::vector<std::thread> threads_;
};

}  // namespace fogbank::service
