// Threads for work that may block: disks, hashing, loading. gRPC reactions post here and return at once.
#pragma once

#include <condition_variable>
#include <deque>
#include <functional>
#include <mutex>
#include <string>
#include <thread>
#include <vector>

namespace fogbank::service {

/// Runs tasks in the order in which they are posted, on a fixed number of threads. Thread-safe.
class TaskQueue {
 public:
  /// `name` shows in debuggers and `top`; at most 15 characters.
  TaskQueue(std::string name, int threads);
  /// As `close`.
  ~TaskQueue();

  /// The task must not throw. Returns false, without taking the task, after `close`.
  bool post(std::function<void()> task);
  /// Tasks waiting, running ones not counted.
  size_t waiting() const;
  /// Neither waiting nor running tasks.
  bool idle() const;
  /// Runs what was posted before and joins the threads.
  void close();

 private:
  void work();

  mutable std::mutex mutex_;
  std::condition_variable wake_;
  std::deque<std::function<void()>> tasks_;
  int running_ = 0;
  bool closed_ = false;
  std::string name_;
  std::vector<std::thread> threads_;
};

}  // namespace fogbank::service
